"""How far the gap shrinks on seconds that a fit has not seen, with intervals over seconds.

Every second is predicted by a fit without the half of the log that it is in. These fits differ from
that of the whole log by one Gauss-Newton step along its slopes, so no replay is needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.evidence.gap import excess, root_weights
from diagnosis.search.fit import RIDGE, Fit, Fitter
from diagnosis.search.problem import Problem
from diagnosis.search.quadratic import lowest

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
    problem = Problem.of(fitter.parameters, fit.freed, {}, None)
    numbers = [n for n, k in enumerate(problem.numbers) if k in fit.slopes]
    if not numbers:
        return fit.residual
    weights = root_weights(fitter.evidence, fit.residual)
    slopes = np.stack([fit.slopes[problem.numbers[n]] for n in numbers], axis=1)
    rows, left = slopes * weights[:, None], fit.residual * weights
    sizes = problem.at(fit.u)[numbers]
    precision = problem.sd[numbers] ** -2.0
    pull = (sizes - problem.centre[numbers]) * precision
    room = problem.low[numbers] - sizes, problem.high[numbers] - sizes
    found = np.empty_like(fit.residual)
    half = fitter.evidence.seconds % HALVES
    for number in range(HALVES):
        seen, unseen = half != number, half == number
        curvature = rows[seen].T @ rows[seen] + np.diag(precision)
        curvature += RIDGE * np.diag(np.diag(curvature))
        step = lowest(curvature, rows[seen].T @ left[seen] - pull, *room)
        found[unseen] = (fit.residual - slopes @ step)[unseen]
    return found


def by_second(evidence: Evidence, residual: Array) -> Array:
    """Root mean square of residuals (M,) by joint and second (K, S); NaN where there are none."""
    count = int(evidence.second.max()) + 1
    found = np.full((len(evidence.parts), count), np.nan)
    for j, part in enumerate(evidence.parts):
        samples = np.bincount(evidence.seconds[part], minlength=count)
        squares = np.bincount(evidence.seconds[part], residual[part] ** 2, minlength=count)
        there = samples > 0
        found[j, there] = np.sqrt(squares[there] / samples[there])
    return found


def gaps_and_shares(
    limbs: Sequence[tuple[Array, Array, Array]], seed: int = 0
) -> tuple[Gaps, Share, Share]:
    """Gaps, and the shares of the squared gap beyond one floor that are gone.

    The second share is that of the nominal numbers alone. `limbs`: of each, `by_second` before,
    with its nominal numbers refitted, and with its causes.
    """
    rng = np.random.default_rng(seed)
    counts = [limb[0].shape[1] for limb in limbs]
    picks = [[rng.integers(count, size=count) for count in counts] for _ in range(RESAMPLES)]
    value = _figures(limbs, [np.arange(count) for count in counts])
    low, high = np.percentile([_figures(limbs, one) for one in picks], [5, 95], axis=0)
    before, nominal, after, gone, gone_nominal = (
        Share(value=float(v), interval=(float(a), float(b)))
        for v, a, b in zip(value, low, high, strict=True)
    )
    return Gaps(before=before, nominal=nominal, after=after), gone, gone_nominal


def _figures(limbs: Sequence[tuple[Array, Array, Array]], picks: Sequence[Array]) -> list[float]:
    """The three gaps and the two shares, from the seconds picked in every limb."""
    gaps = []
    for number in range(3):
        pairs = zip(limbs, picks, strict=True)
        gaps.append(np.concatenate([_means(limb[number][:, pick]) ** 2 for limb, pick in pairs]))
    before, nominal, after = (excess(gap2) for gap2 in gaps)
    whole = max(before, 1e-9)
    worst = [float(np.sqrt(gap2.max())) for gap2 in gaps]
    return [*worst, 1 - after / whole, 1 - nominal / whole]


def _means(values: Array) -> Array:
    """Means over seconds (K, S) -> (K,), of the seconds that a joint has."""
    there = np.isfinite(values)
    return np.where(there, values, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
