"""Fits of candidate worlds to evidence, with nominal parameters free within their uncertainty."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.profile import Fit, Profile, grown

FARTHEST = 5.0
"""Nominal parameters stay within so many standard deviations, unless less is asked for."""
NUDGE = 2e-3
"""A change of a magnitude that should change next to nothing, relative."""
CALM = 0.06
"""Value from which a fit counts as chaotic."""
SWAY, SWAYS = 0.01, 6
"""How far off magnitudes may be when a fit predicts a joint in its play, and worlds tried."""
KEPT = 0.7
"""A step that does this share of what it promises is taken as it is."""
DAMPINGS = (0.0, 0.3, 10.0)
"""How much steps are damped, one after the other, as a share of the curvature."""
POLISH = (1.8, 1.3, 1.1, 1.0, 1.0)
"""How far around the last magnitude, as a factor, the rounds of a refit search; 1: they do not."""
ENOUGH = 0.3
"""A refit ends when a round lowers the cost by less [nats]."""


@dataclass(frozen=True, kw_only=True)
class Nuisance:
    """A nominal parameter: an effect whose magnitude is small and not asked for."""

    kind: type[Effect]
    joint: str | None
    """None: one for all joints."""
    std: float
    """Prior standard deviation of its magnitude."""

    def at(self, deviations: float) -> Effect:
        """The effect at a number of standard deviations."""
        return self.kind(magnitude=float(deviations * self.std), joint=self.joint)


class Fitter:
    """Fits to one limb's evidence: to the samples for fitting, or to all where `judged` is None."""

    def __init__(
        self,
        evidence: Evidence,
        nuisances: Sequence[Nuisance],
        judged: bool | None = False,
        farthest: float = FARTHEST,
    ) -> None:
        self.evidence, self.nuisances, self._judged = evidence, tuple(nuisances), judged
        self.farthest = farthest
        """Standard deviations within which nominal parameters stay."""
        self._profiles: dict[tuple, Profile] = {}

    def __reduce__(self) -> tuple:
        """To another process go no profiles."""
        return Fitter, (self.evidence, self.nuisances, self._judged, self.farthest)

    def profile(self, fit: Fit) -> Profile:
        """The profile around a fit, from the latest one of these effects where that is near."""
        kind = tuple((type(effect), effect.joint) for effect in fit.effects)
        near = self._profiles.get(kind)
        self._profiles[kind] = (near and near.moved(fit)) or Profile(self, fit)
        return self._profiles[kind]

    def left(self, fit: Fit) -> Array:
        """Squared residuals of a fit on the samples for judging, see `Evidence.residual`."""
        return self.evidence.residual(self.effects(fit), True, False) ** 2

    def new(self, fit: Fit) -> Array:
        """Innovations of a fit on the samples for judging, see `Evidence.innovations`."""
        return self.evidence.innovations(self.effects(fit), True)

    def unrest(self, fit: Fit) -> float:
        """How chaotic a fit is, with magnitudes that are larger by `NUDGE`."""
        moved = [grown(effect, 1 + NUDGE) for effect in fit.effects]
        both = (self._all(effects, fit.deviations) for effects in (fit.effects, moved))
        return self.evidence.unrest(*both)

    def forgiving(self, fit: Fit) -> Evidence:
        """The evidence with a fit's prediction spread, magnitudes being up to `SWAY` off."""
        sways = 1 + SWAY * np.linspace(-1, 1, SWAYS)
        moved = [self._all([grown(e, s) for e in fit.effects], fit.deviations) for s in sways]
        return self.evidence.forgiving(self.effects(fit), moved)

    def innovations(self, effects: Iterable[Effect], deviations: Array) -> Array:
        """Innovations of a candidate on the samples that are fitted."""
        return self.evidence.innovations(self._all(effects, deviations), self._judged)

    def allowing_for(self, fit: Fit) -> "Fitter":
        """The fitter on `Evidence.allowing_for` what a fit leaves."""
        evidence = self.evidence.allowing_for(self.effects(fit))
        return Fitter(evidence, self.nuisances, self._judged)

    def _all(self, effects: Iterable[Effect], deviations: Array) -> list[Effect]:
        pairs = zip(self.nuisances, deviations, strict=True)
        return [*(n.at(d) for n, d in pairs if d != 0.0), *effects]

    def effects(self, fit: Fit) -> list[Effect]:
        """All that a fit adds to the nominal world."""
        return self._all(fit.effects, fit.deviations)

    def world(self, fit: Fit) -> Spec:
        """The world of a fit."""
        return self.evidence.world(self.effects(fit))

    def cost(self, effects: Iterable[Effect], deviations: Array) -> float:
        """See `Fit.cost`."""
        new = self.innovations(effects, deviations)
        return float(new @ new + deviations @ deviations) / 2

    def free(self, effects: Iterable[Effect]) -> Array:
        """Nominal parameters beside these effects (K,): not those that an effect itself changes."""
        taken = [(type(e), e.joint) for e in effects]
        return np.array(
            [
                not any(issubclass(k, n.kind) and j in (None, n.joint) for k, j in taken)
                for n in self.nuisances
            ],
            dtype=bool,
        )

    def at(self, effects: tuple[Effect, ...], deviations: Array) -> Fit:
        """A fit with its cost; nominal parameters that an effect itself changes are not moved."""
        kept = deviations * self.free(effects)
        return Fit(effects=effects, deviations=kept, cost=self.cost(effects, kept))

    def nominal(self) -> Fit:
        """The nominal parameters refitted alone: what a calibration would reach."""
        return self.refit(self.at((), np.zeros(len(self.nuisances))))

    def refit(self, fit: Fit, rounds: Sequence[float] = POLISH) -> Fit:
        """Everything free, around a fit: new slopes, then each magnitude searched, in rounds."""
        for reach in rounds:
            profile, before = self.profile(fit), fit.cost
            fit = self._stepped(fit, profile)
            for index in range(len(fit.effects) if reach > 1 else 0):
                fit = self._checked(fit, profile.search(fit.effects, index, reach))
            if before - fit.cost < ENOUGH:
                break
        return fit

    def _stepped(self, fit: Fit, profile: Profile) -> Fit:
        """A step of Gauss and Newton, or shorter ones nearer to the steepest (Marquardt, 1963)."""
        for damping in DAMPINGS:
            guess = profile.at(fit.effects, damping=damping)
            if fit.cost - guess.cost < ENOUGH:
                break
            better = self._checked(fit, guess)
            if better.cost < fit.cost:
                return better
        return fit

    def _checked(self, fit: Fit, guess: Fit) -> Fit:
        """The guess where it does nearly what it promises, or the best part of its move."""
        best, promised = fit, fit.cost - guess.cost
        for share in (1.0, 0.4, 0.1):
            pairs = zip(fit.effects, guess.effects, strict=True)
            effects = tuple(_between(a, b, share) for a, b in pairs)
            deviations = fit.deviations + share * (guess.deviations - fit.deviations)
            cost = self.cost(effects, deviations)
            if cost < best.cost:
                best = Fit(effects=effects, deviations=deviations, cost=cost)
            if fit.cost - best.cost >= KEPT * promised:
                break
        return best


def _between(a: Effect, b: Effect, share: float) -> Effect:
    """An effect between two of one sign, by their logarithms."""
    if a.magnitude == b.magnitude:
        return b
    return replace(a, magnitude=float(a.magnitude * (b.magnitude / a.magnitude) ** share))
