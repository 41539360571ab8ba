"""Fits of candidate worlds to evidence, with the nominal parameters free within their uncertainty.

The nominal parameters' influence is linear to first order, and so is that of effects that are
already in the fit, so for every magnitude of one more effect the best of them follow from one
linear solve (variable projection; Golub and Pereyra, 1973), and only this magnitude is searched.
Searching survives what slopes do not: delays have kinks, play rattles.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.evidence import Evidence

STEP = 0.03
"""Step of a derivative by a nominal parameter, in its standard deviations."""
GROW = 0.01
"""Step of a derivative by a magnitude, relative."""
NUDGE = 2e-3
"""A change of a magnitude that should change next to nothing, relative."""
CALM = 0.1
"""Unrest from which a fit is restless, see `Evidence.unrest`."""
SWAY, SWAYS = 0.01, 6
"""How far off magnitudes may be when a fit foretells a joint in its play, and worlds tried."""
FARTHEST = 5.0
"""Nominal parameters stay within so many standard deviations."""
LEAP = 0.7
"""One linear step changes the logarithm of a magnitude by no more."""
KEPT = 0.7
"""A step that does this share of what it promises is taken as it is."""
DAMPINGS = (0.0, 0.3, 10.0)
"""How much steps are damped, one after the other, as a share of the curvature."""
LOOSE = 1e-4
"""Weight of the prior of a magnitude's logarithm: it says nothing."""
SEARCHES = 7
"""Magnitudes tried in one search."""
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


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A candidate world at its best."""

    effects: tuple[Effect, ...]
    """The effects asked for, with fitted magnitudes; empty: nominal parameters alone."""
    deviations: Array
    """Fitted nominal parameters in standard deviations, shape (K,)."""
    cost: float
    """Half the squared innovations on the samples that it was fitted on, plus the prior's."""


class Fitter:
    """Fits to one limb's evidence: to the samples for fitting, or to all where `judged` is None."""

    def __init__(
        self, evidence: Evidence, nuisances: Sequence[Nuisance], judged: bool | None = False
    ) -> None:
        self.evidence, self.nuisances, self._judged = evidence, tuple(nuisances), judged

    def left(self, fit: Fit) -> Array:
        """Squared residuals of a fit on the samples for judging, see `Evidence.residual`."""
        effects = self._all(fit.effects, fit.deviations)
        return self.evidence.residual(effects, True, False) ** 2

    def new(self, fit: Fit) -> Array:
        """Innovations of a fit on the samples for judging, see `Evidence.innovations`."""
        return self.evidence.innovations(self._all(fit.effects, fit.deviations), True)

    def unrest(self, fit: Fit) -> float:
        """See `Evidence.unrest`: with magnitudes that are larger by `NUDGE`."""
        moved = [grown(effect, 1 + NUDGE) for effect in fit.effects]
        both = (self._all(effects, fit.deviations) for effects in (fit.effects, moved))
        return self.evidence.unrest(*both)

    def forgiving(self, fit: Fit) -> Evidence:
        """`Evidence.forgiving` of a fit, with magnitudes that are up to `SWAY` off."""
        sways = 1 + SWAY * np.linspace(-1, 1, SWAYS)
        moved = [self._all([grown(e, s) for e in fit.effects], fit.deviations) for s in sways]
        return self.evidence.forgiving(self._all(fit.effects, fit.deviations), moved)

    def innovations(self, effects: Iterable[Effect], deviations: Array) -> Array:
        """Innovations of a candidate on the samples that are fitted."""
        return self.evidence.innovations(self._all(effects, deviations), self._judged)

    def allowing_for(self, fit: Fit) -> "Fitter":
        """The fitter on `Evidence.allowing_for` what a fit leaves."""
        evidence = self.evidence.allowing_for(self._all(fit.effects, fit.deviations))
        return Fitter(evidence, self.nuisances, self._judged)

    def _all(self, effects: Iterable[Effect], deviations: Array) -> list[Effect]:
        pairs = zip(self.nuisances, deviations, strict=True)
        return [*(n.at(d) for n, d in pairs if d != 0.0), *effects]

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
        """Everything free, around a fit: slopes anew, then each magnitude searched, in rounds."""
        for reach in rounds:
            profile, before = Profile(self, fit), fit.cost
            fit = self._stepped(fit, profile)
            for index in range(len(fit.effects) if reach > 1 else 0):
                fit = self._checked(fit, profile.search(fit.effects, index, reach))
            if before - fit.cost < ENOUGH:
                break
        return fit

    def _stepped(self, fit: Fit, profile: "Profile") -> Fit:
        """A step of Gauss and Newton, or shorter ones nearer to the steepest (Marquardt, 1963)."""
        for damping in DAMPINGS:
            better = self._checked(fit, profile.at(fit.effects, damping=damping))
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


def grown(effect: Effect, factor: float) -> Effect:
    """An effect so many times as large, within its bounds."""
    low, high = effect.bounds
    return replace(effect, magnitude=float(np.clip(effect.magnitude * factor, low, high)))


class Profile:
    """Costs of effects at any magnitude, with all else at its linear best around a fit.

    What else there is: nominal parameters, and the magnitudes of effects in the fit.
    """

    def __init__(self, fitter: Fitter, around: Fit) -> None:
        self._fitter, self._around = fitter, around
        start, effects = around.deviations, around.effects
        base = fitter.innovations(effects, start)
        columns = [
            (fitter.innovations(effects, start + STEP * unit) - base) / STEP
            for unit in np.eye(len(start))
        ]
        for index, effect in enumerate(effects):
            factor = 1 + GROW
            if grown(effect, factor).magnitude == effect.magnitude:
                factor = 1 - GROW
            moved = _swapped(effects, index, grown(effect, factor))
            columns.append((fitter.innovations(moved, start) - base) / np.log(factor))
        self._slopes = np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))
        self._prior = np.array([1.0] * len(start) + [LOOSE] * len(effects))
        self._normal = _products(self._slopes, self._slopes) + np.diag(self._prior)

    def at(self, effects: tuple[Effect, ...], held: int | None = None, damping: float = 0.0) -> Fit:
        """These effects with the best of all else and the linear cost.

        The first of them are those of the fit around, one of which, `held`, may have another
        magnitude and keeps it; those beyond keep theirs.
        """
        around, fitter = self._around, self._fitter
        count, given = len(around.deviations), len(around.effects)
        free = fitter.free(effects)
        start = around.deviations * free
        loose = np.array([*free, *(index != held for index in range(given))], dtype=bool)
        base = fitter.innovations(effects, start)
        slopes = self._slopes * loose
        pull = _products(slopes, base[:, None])[:, 0] + self._prior * np.concatenate(
            [start, np.zeros(given)]
        )
        normal = self._normal
        low = np.concatenate([-FARTHEST - start, np.full(given, -LEAP)]) * loose
        high = np.concatenate([FARTHEST - start, np.full(given, LEAP)]) * loose
        move = _lowest(normal + damping * np.diag(np.diag(normal)), pull, low, high)
        cost = base @ base + start @ start + 2 * pull @ move + move @ normal @ move
        moved = tuple(
            grown(e, np.exp(move[count + k])) if k < given and k != held else e
            for k, e in enumerate(effects)
        )
        return Fit(effects=moved, deviations=start + move[:count], cost=float(cost / 2))

    def pulled(self, moved: Array) -> Array:
        """How the logarithms of all magnitudes move when innovations do so (n,), to first order."""
        given = len(self._around.effects)
        free = np.array([*self._fitter.free(self._around.effects), *([True] * given)])
        normal, pull = self._normal[np.ix_(free, free)], _products(self._slopes, moved[:, None])
        return -np.linalg.solve(normal, pull[free, 0])[free.sum() - given :]

    def search(self, effects: tuple[Effect, ...], index: int, reach: float) -> Fit:
        """The best magnitude of one effect within a factor `reach` of the one it has.

        Effects of the fit around, other than this one, start from there.
        """
        effect, given = effects[index], self._around.effects
        effects = (*(effects[k] if k == index else e for k, e in enumerate(given)),) + effects[
            len(given) :
        ]
        sign, size = np.sign(effect.magnitude), abs(effect.magnitude)
        most = max(abs(bound) for bound in effect.bounds if bound * sign > 0)
        tried: list[Fit] = [self.at(effects, index)]

        def cost(log_size: float) -> float:
            moved = replace(effect, magnitude=float(sign * min(np.exp(log_size), most)))
            tried.append(self.at(_swapped(effects, index, moved), index))
            return tried[-1].cost

        bounds = np.log([size / reach, min(size * reach, most)])
        if bounds[1] > bounds[0]:
            minimize_scalar(cost, bounds=bounds, method="bounded", options={"maxiter": SEARCHES})
        return min(tried, key=lambda one: one.cost)


def _lowest(normal: Array, pull: Array, low: Array, high: Array) -> Array:
    """The move m of least pull m + m normal m / 2 within bounds (K,), which stop it one by one."""
    move, free = np.zeros(len(pull)), low < high
    while True:
        held = pull + normal @ (move * ~free)
        move[free] = -np.linalg.solve(normal[np.ix_(free, free)], held[free])
        inside = np.clip(move, low, high)
        if (inside == move).all():
            return move
        move, free = inside, free & (inside == move)


def _products(a: Array, b: Array) -> Array:
    """Products of columns, (n, A) and (n, B) to (A, B); BLAS would wake a thread per core."""
    return np.einsum("na,nb->ab", a, b)


def _swapped(effects: tuple[Effect, ...], index: int, effect: Effect) -> tuple[Effect, ...]:
    return (*effects[:index], effect, *effects[index + 1 :])
