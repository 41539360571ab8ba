"""How far the gap shrinks on seconds that a fit has not seen, with intervals over seconds.

Every second is predicted by a fit without the half of the log that it is in. These fits differ from
that of the whole log by one Gauss-Newton step along its slopes, so no replay is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import Problem, lowest

HALVES, RESAMPLES = 2, 400


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share, or a gap, with its 90 % interval."""

    value: float
    interval: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Gaps:
    """Gaps in floors: of the log's worst joint, as means over seconds."""

    before: Share
    """As the nominal world stands."""
    nominal: Share
    """With the nominal numbers refitted within their uncertainty, as a calibration would."""
    after: Share
    """With the causes."""


def held_out(fitter: Fitter, fit: Fit) -> Array:
    """Residuals (M,) of a fit, each by the half of the log that it is not in."""
    moved = [k for k in fit.freed if k in fit.slopes]
    problem = Problem.of(fitter.parameters, moved, fit.slopes)
    if not problem.numbers:
        return fit.residual
    weights = root_weights(fitter.evidence, fit.residual)
    now, found = problem.at(fit.u), np.empty_like(fit.residual)
    half = fitter.evidence.seconds % HALVES
    for number in range(HALVES):
        unseen = half == number
        seen = np.where(unseen, 0.0, weights)
        curvature, pull = problem.normal(fit.slopes, seen, fit.residual, fit.u)
        step = lowest(curvature, pull, problem.low - now, problem.high - now)
        moved_by = zip(problem.numbers, step, strict=True)
        found[unseen] = (fit.residual - sum(fit.slopes[k] * by for k, by in moved_by))[unseen]
    return found


def gaps_and_shares(limbs: Sequence[tuple[Array, Array, Array]]) -> tuple[Gaps, Share, Share]:
    """Gaps, and the shares of the squared gap beyond one floor that are gone.

    The second share is that of the nominal numbers alone. `limbs`: of each, `by_second` before,
    with its nominal numbers refitted, and with its causes.
    """
    rng, means = np.random.default_rng(0), []
    for limb in limbs:
        count = limb[0].shape[1]
        drawn = rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
        means.append([_means(one, np.vstack([np.ones(count), drawn])) for one in limb])
    squares = [np.concatenate(parts, axis=1) ** 2 for parts in zip(*means, strict=True)]
    before, nominal, after = (np.maximum(gap2 - 1.0, 0.0).sum(axis=1) for gap2 in squares)
    whole = np.maximum(before, 1e-9)
    worst = [np.sqrt(gap2.max(axis=1)) for gap2 in squares]
    shares = [_share(one) for one in (*worst, 1 - after / whole, 1 - nominal / whole)]
    return Gaps(before=shares[0], nominal=shares[1], after=shares[2]), shares[3], shares[4]


def _means(values: Array, times: Array) -> Array:
    """Means (R, K) of values (K, S) over the seconds there are, which count so often (R, S)."""
    there = np.isfinite(values)
    return times @ np.where(there, values, 0.0).T / np.maximum(times @ there.T, 1)


def _share(drawn: Array) -> Share:
    """The first value, with its interval by the others."""
    low, high = np.percentile(drawn[1:], [5, 95])
    return Share(value=float(drawn[0]), interval=(float(low), float(high)))
