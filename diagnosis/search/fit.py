"""Fits of a limb: its tolerances, and the effects that are let free, by bounded Gauss-Newton.

    minimise |w (y - f(u))|^2 / 2 + |(u - centre) / sd|^2 / 2,   low <= u <= high

Weights w are of the residuals as they are (`evidence.gap`), computed again at each step.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence, excess, root_weights, squared_gaps
from diagnosis.models.parameters import with_parts
from diagnosis.models.world import World
from diagnosis.motion.columns import PLAY, SOFT
from diagnosis.motion.limb import Limb
from diagnosis.search.problem import Problem, lowest
from diagnosis.verdict.ordinary import SHAPE_LEFT, Gap, Ordinary

STEPS, AGAIN = 7, 2
"""Steps of a fit; at the step AGAIN the slopes of tolerances are computed again where one has moved
by more than they are taken over. Slopes from elsewhere are so there, and where steps win little."""
DAMPINGS = (1.0, 0.4, 0.12)
"""Shares of a step that are tried."""
DONE, DONE_SHARE, DONE_EXACT = 0.02, 3e-3, 1e-4
"""A fit ends when a step wins less than this and this share of the cost; where the law is exact,
single nats count."""
HALVED = 4
"""So often an effect is halved with which the motion diverges."""
FITS, FAR, CLOSED = 4, 3.0, 0.15
"""Tolerances are fitted on at most so often, beyond a gap of so many floors, while a fit closes
this share of the excess."""
HOPELESS = 1.5
"""A fit that leaves so many times what another left does not catch up."""
USUAL = 4.0
"""Tolerances together are a gap beyond so many standard deviations of healthy robots'."""
SMALL, LARGE = 0.3, 0.03
"""Slopes are taken over this share of an effect's least size, or of its size where it has one."""
FINE = 0.02
"""Where a fit ends, its slopes are taken over this share of that: larger steps cross valleys."""
WIDEST = 0.1
"""Of tolerances over a standard deviation, at most this: a guess may be off by whole multiples."""
SIMULATED = 1.25
"""Dry friction that yields as a simulator's leaves so many times less [squared]: most logs are of
robots."""
ALIKE = 0.1
"""Fits that differ by less leave the same [squared floors]."""
SEEN = 0.05
"""A tolerance shows that is worth such a gap of some joint, see `squared_gaps` [floors]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Gap):
    """Parameters by number: those that were let free, and where all are."""

    freed: tuple[int, ...]
    u: Mapping[int, float]
    residual: Array
    """What is left, in floors (M,)."""
    prior: float = 0.0
    """What the sizes of the tolerances cost [nats]."""
    sd: Mapping[int, float] = field(default_factory=dict)
    """Standard deviations of what was fitted."""
    slopes: Mapping[int, Array] = field(default_factory=dict)
    """How readings follow from each parameter (M,), as last taken."""


@dataclass(frozen=True, kw_only=True)
class Usual:
    """How large the tolerances of a healthy robot are together.

    The sum of their squares, in standard deviations, is that of normal numbers, as far as a log
    tells of them: each counts by h = 1 - (its standard deviation after the fit over that before)^2.
    Its mean is sum h and its variance 2 sum h^2 (of a quadratic form of normal numbers).
    """

    mean: float
    sd: float
    floors: float
    """An ordinary gap: so many floors are `USUAL` standard deviations worth."""

    def off(self, fit: Fit) -> float:
        """Further off than healthy robots' so many standard deviations, all together."""
        return (2.0 * fit.prior - self.mean) / max(self.sd, 1.0)

    def on(self, fit: Fit) -> Fit:
        """The fit, whose tolerances together count as a gap."""
        return replace(fit, strain2=self.floors**2 * max(self.off(fit), 0.0) / USUAL)


class Fitter(World):
    """A limb's world, and its fits."""

    usual: Usual | None = None

    def of(self, limb: Limb) -> "Fitter":
        """The same fits of the limb under other commands."""
        return Fitter(replace(self.evidence, limb=limb), self.parameters)

    def strained(self, fit: Fit, ordinary: Ordinary) -> Fit:
        """A fit of the tolerances alone: where they are unusual together, that counts from now on.

        Not where more is left than beside a model that lacks nothing, for there they make up for
        what it lacks; nor where likelihoods count it already.
        """
        if ordinary.exact or fit.gap > SHAPE_LEFT:
            return fit
        known = np.array([1 - (sd / self.parameters[k].tolerance) ** 2 for k, sd in fit.sd.items()])
        spread = float(np.sqrt(2.0 * known @ known))
        usual = Usual(mean=float(known.sum()), sd=spread, floors=ordinary.floors)
        self.usual = usual if usual.off(fit) > USUAL else None
        return self.usual.on(fit) if self.usual else fit

    def fit(
        self,
        freed: Sequence[int] = (),
        u: Mapping[int, float] | None = None,
        moving: Collection[int] | None = None,
        slopes: Mapping[int, Array] | None = None,
        steps: int = STEPS,
        beat: float = np.inf,
        again: bool = True,
        over: float = 1.0,
    ) -> Fit:
        """All tolerances and the freed effects, or those of them that are `moving`, from u.

        `slopes`: of tolerances, as taken nearby; `again`: whether they are computed again on the
        way, all `over` a share of their steps. A fit that then leaves far more than the excess
        `beat` ends early.
        """
        u, problem = dict(u or {}), Problem.of(self.parameters, freed, moving)
        own = with_parts(self.parameters, freed)
        known = {k: s for k, s in (slopes or {}).items() if k not in own}
        columns = [k for k in u if u[k] and self.is_column(k, freed)]
        base = self.bare(u, freed)
        for _ in range(HALVED):
            if np.isfinite(base).all():
                break
            u |= {k: u[k] / 2.0 for k in freed if k in u}
            base = self.bare(u, freed)
        needed = dict.fromkeys((*problem.numbers, *columns))
        known |= self.slopes([k for k in needed if k not in known], u, freed, base, over)
        shown = base + self._columns(u, freed, known)
        if not np.isfinite(shown).all():
            infinite = np.full(len(self.evidence.parts), np.inf)
            residual = np.zeros_like(self.evidence.readings)
            return Fit(freed=tuple(freed), u=u, residual=residual, gap2=infinite)
        curvature, stale = np.diag(problem.sd**-2.0), again and slopes is not None
        held, began = np.array([k not in own for k in problem.numbers]), problem.at(u)
        done_share = DONE_EXACT if self.evidence.limb.exact else DONE_SHARE
        for step in range(steps):
            residual = self.evidence.readings - shown
            weights = root_weights(self.evidence, residual)
            now, (curvature, pull) = problem.at(u), problem.normal(known, weights, residual, u)
            move = lowest(curvature, pull, problem.low - now, problem.high - now)
            most = problem.largest_step(now)
            move = np.clip(move, -most, most)
            cost, won = _cost(residual, weights) + problem.prior(u), 0.0
            for damping in DAMPINGS:
                there = problem.put(u, now + damping * move)
                other = self.bare(there, freed) + self._columns(there, freed, known)
                left = _cost(self.evidence.readings - other, weights) + problem.prior(there)
                if left < cost:
                    u, shown, won = there, other, cost - left
                    break
            small = won < DONE + done_share * cost
            if (small and step > 0 and not stale) or step == steps - 1:
                break
            if step == AGAIN and self._excess(shown) > HOPELESS * beat:
                break
            moved = np.abs(problem.at(u) - began)[held] > np.minimum(problem.sd[held], WIDEST)
            far = again and step == AGAIN and (stale or bool(moved.any()))
            anew = far or (stale and small)
            stale = stale and not anew
            fresh = [k for k in problem.numbers if k in own or anew]
            known |= self.slopes(fresh, u, freed, self.bare(u, freed), over)
        residual = self.evidence.readings - shown
        sd = np.sqrt(np.maximum(np.diag(np.linalg.inv(curvature)), 0.0))
        fit = Fit(
            freed=tuple(freed),
            u=u,
            residual=residual,
            gap2=squared_gaps(self.evidence, residual),
            prior=Problem.of(self.parameters, freed).prior(u),
            sd=dict(zip(problem.numbers, map(float, sd), strict=True)),
            slopes=known,
        )
        return self.usual.on(fit) if self.usual else fit

    def fine(self, fit: Fit) -> Fit:
        """A fit that goes on with slopes over small steps, which its spreads are not of."""
        more = self.fit(fit.freed, fit.u, again=False, over=FINE)
        return replace(self.better(more, fit), sd=fit.sd, slopes=fit.slopes)

    def settled(
        self,
        u: Mapping[int, float] | None = None,
        again: int = 0,
        slopes: Mapping[int, Array] | None = None,
    ) -> Fit:
        """The tolerances alone, fitted on until a fit closes little more.

        A large gap bends them so far that slopes change. `again`: so many times in any case.
        `slopes`: see `fit`.
        """
        fit = self.fit(u=u, slopes=slopes)
        for number in range(FITS):
            is_more = number < again or fit.worst > FAR
            more = self.fit(u=fit.u, slopes=fit.slopes) if is_more else fit
            closed = fit.excess - more.excess
            fit = self.better(more, fit)
            if number >= again and closed < CLOSED * fit.excess:
                break
        return fit

    def better(self, one: Fit, other: Fit) -> Fit:
        """Of two fits of the same effects, the one that leaves less.

        Where they leave the same, what a fit minimises decides: there tolerances count as well.
        """
        less = self._left(one) - self._left(other)
        if abs(less) <= ALIKE:
            cost, beside = costs(self.evidence, (one, other))
            less = cost - beside
        return one if less < 0.0 else other

    def seen(self, fit: Fit) -> dict[int, float]:
        """The parameters of a fit, without tolerances that hardly show: no model needs them.

        Nor does a rigid drive need a gear for tolerances of it, which are there by their slopes.
        """
        moved = {k: fit.slopes[k] * v for k, v in fit.u.items() if k in fit.slopes}
        sizes = {k: np.sqrt(squared_gaps(self.evidence, x).max()) for k, x in moved.items()}
        geared = not self.evidence.limb.rigid
        return {
            k: v
            for k, v in fit.u.items()
            if k in fit.freed
            or (sizes.get(k, SEEN) >= SEEN and (geared or not self.is_column(k, fit.freed)))
        }

    def _left(self, fit: Fit) -> float:
        """What a fit leaves [squared]; that of a simulator stands back behind that of a robot."""
        yields = any(self.parameters[k].place == SOFT for k, size in fit.u.items() if size)
        return fit.excess * (SIMULATED if yields else 1.0)

    def excess_at(self, u: Mapping[int, float]) -> float:
        """What parameters at u leave as they stand; infinite where there is no motion."""
        left = self._excess(self.shown(u))
        return left if np.isfinite(left) else np.inf

    def _excess(self, shown: Array) -> float:
        return excess(squared_gaps(self.evidence, self.evidence.readings - shown))

    def is_column(self, number: int, freed: Collection[int]) -> bool:
        """Whether a parameter only adds its slope: gears' kinks as tolerances.

        A gear with play that is replayed is replayed with its twist.
        """
        one, free = self.parameters[number], [self.parameters[k] for k in freed]
        plays = any(other.place == PLAY and other.joint == one.joint for other in free)
        return one.kind.by_column and number not in freed and not plays

    def bare(self, u: Mapping[int, float], freed: Collection[int]) -> Array:
        """What is shown without the parameters that only add their slope."""
        return self.shown({k: v for k, v in u.items() if not self.is_column(k, freed)})

    def slopes(
        self,
        numbers: Iterable[int],
        u: Mapping[int, float],
        freed: Collection[int],
        base: Array,
        over: float = 1.0,
    ) -> dict[int, Array]:
        """How readings follow from parameters at u, where `bare` is `base`; 0 if they diverge.

        `over`: this share of the `step` that shows.
        """
        plain = {k: v for k, v in u.items() if not self.is_column(k, freed)}
        found = {}
        for k in numbers:
            now, before = plain.get(k, 0.0), base
            step = over * self.step(k, now)
            if self.is_column(k, freed) and self.evidence.limb.rigid:
                now, before = step, self.shown({**plain, k: step})  # a gear is there in both
            moved = self.shown({**plain, k: now + step})
            found[k] = np.nan_to_num((moved - before) / step)
        return found

    def step(self, number: int, now: float) -> float:
        """A change of a parameter that shows."""
        one = self.parameters[number]
        small = max(min(one.tolerance, WIDEST), SMALL * one.least)
        step = small if abs(now) < one.least else LARGE * abs(now)
        return -step if now < 0.0 else step

    def _columns(
        self, u: Mapping[int, float], freed: Collection[int], known: Mapping[int, Array]
    ) -> Array | float:
        return sum(known[k] * v for k, v in u.items() if v and self.is_column(k, freed))


def costs(
    evidence: Evidence,
    fits: Sequence[Fit],
    weigh: Callable[[Evidence, Array], Array] = root_weights,
) -> list[float]:
    """What fits minimise, all with the root weights that residuals of the nearest have [nats]."""
    if not fits:
        return []
    nearest = min(fits, key=lambda fit: float(fit.residual @ fit.residual))
    weights = weigh(evidence, nearest.residual)
    return [_cost(fit.residual, weights) + fit.prior for fit in fits]


def _cost(residual: Array, weights: Array) -> float:
    """Half the weighted sum of squares; infinite where the replay diverged."""
    cost = float(((residual * weights) ** 2).sum()) / 2
    return cost if np.isfinite(cost) else np.inf
