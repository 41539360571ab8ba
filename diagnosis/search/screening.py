"""Which effects may close a gap: what a linear step of all tolerances and the effect would win."""

from collections.abc import Mapping, Sequence

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.models.parameters import Parameter, with_parts
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import RIDGE, Problem, lowest

SIZES = (2.0, 6.0, 40.0)
"""Multiples of the least size over which an effect's slope is taken: the first alone where effects
go both ways without a kink or are at a spot, all where a large one shows what a small one hides."""


Chords = dict[tuple[int, float], Array]
"""What effects change of readings over a size, by number and size (M,)."""


def screened(
    fitter: Fitter, fit: Fit, effects: Sequence[int], chords: Chords
) -> tuple[dict[int, float], Mapping[int, Array]]:
    """Effects by number, with the sizes that promise most, the best first; and all slopes there.

    An effect stands in place of its own tolerance. `chords`: as taken nearby, and then those that
    are taken here as well.
    """
    free = {k: v for k, v in fit.u.items() if not fitter.is_column(k, fit.freed)}
    base, problem = fitter.shown(free), Problem.of(fitter.parameters, fit.freed)
    unknown = [k for k in problem.numbers if k not in fit.slopes]
    slopes = {**fit.slopes, **fitter.slopes(unknown, fit.u, fit.freed, base)}
    weights = root_weights(fitter.evidence, fit.residual)
    jacobian = problem.jacobian(slopes, weights)
    curvature, pull = problem.normal(slopes, weights, fit.residual, fit.u)
    left, sizes = fit.residual * weights, problem.at(fit.u)
    low, high = problem.low - sizes, problem.high - sizes

    def promise(number: int) -> tuple[float, float]:
        """What it wins of the cost, and the size that wins it."""
        one, now = fitter.parameters[number], free.get(number, 0.0)
        rest, best = np.array([k != number for k in problem.numbers]), (0.0, 0.0)
        for size in _sizes(one):
            columns = np.stack(changes(number, size, now), axis=1) * weights[:, None]
            shared = (jacobian.T @ columns)[rest]
            own = columns.T @ columns
            own += RIDGE * np.diag(np.diag(own) + 1.0)
            bend = np.block([[curvature[np.ix_(rest, rest)], shared], [shared.T, own]])
            slope = np.concatenate([pull[rest], columns.T @ left])
            parts = np.full(len(own) - 1, np.inf)
            least, most = one.lowest, one.most
            if len(parts):
                least, most = (size, most) if size > 0.0 else (least, size)
            step = lowest(
                bend,
                slope,
                np.concatenate([low[rest], [least], -parts]),
                np.concatenate([high[rest], [most], parts]),
            )
            gain = float(slope @ step - step @ bend @ step / 2)
            best = max(best, (gain, now + float(step[rest.sum()])), key=lambda pair: pair[0])
        return best

    def changes(number: int, size: float, now: float) -> list[Array]:
        """What the effect changes of readings, and each number of its law beside it (M,)."""
        there = {**free, number: now + size}
        if (number, size) not in chords:
            chords[number, size] = np.nan_to_num(fitter.shown(there) - base) / size
        parts = [k for k in with_parts(fitter.parameters, [number]) if k != number]
        for k in parts:
            if (k, size) not in chords:
                step = fitter.step(k, 0.0)
                moved = fitter.shown({**there, k: step}) - fitter.shown(there)
                chords[k, size] = np.nan_to_num(moved) / step
        return [chords[k, size] for k in (number, *parts)]

    found = {k: promise(k) for k in effects}
    ranked = sorted(found, key=lambda k: -found[k][0])
    return {k: found[k][1] for k in ranked}, slopes


def _sizes(one: Parameter) -> tuple[float, ...]:
    """Sizes over which an effect's slope is taken."""
    ways = (1.0, -1.0) if one.lowest < 0.0 else (1.0,)
    curved = one.kind.kinked or not (one.lowest < 0.0 or one.kind.spot)
    multiples = SIZES if curved else SIZES[:1]
    sizes = (w * min(m * one.least, one.most) for m in multiples for w in ways)
    return tuple(max(size, one.lowest) for size in sizes)
