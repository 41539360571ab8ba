"""Which effects may close a gap: what a linear step of all tolerances and the effect would win."""

from collections.abc import Mapping, Sequence

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.models.parameters import Parameter, with_parts
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import RIDGE, Problem, lowest

SIZES = (2.0, 6.0)
"""Multiples of the least size over which an effect's slope is taken."""
KINKS = (3.0, 12.0, 40.0)
"""The same of an effect whose law has a kink."""


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
    jacobian, curvature, pull = problem.normal(slopes, weights, fit.residual, fit.u)
    left, now = fit.residual * weights, problem.at(fit.u)
    low, high = problem.low - now, problem.high - now

    def promise(number: int) -> tuple[float, float]:
        """What it wins of the cost, with all tolerances within their ends; and its size."""
        one, now = fitter.parameters[number], free.get(number, 0.0)
        rest = np.array([k != number for k in problem.numbers])
        best = -np.inf, 0.0
        for size in _sizes(one):
            columns = np.stack(changes(number, size, now), axis=1) * weights[:, None]
            shared, more = jacobian[:, rest].T @ columns, columns.T @ columns
            more += RIDGE * np.diag(np.diag(more) + 1.0)
            bend = np.block([[more, shared.T], [shared, curvature[np.ix_(rest, rest)]]])
            slope = np.concatenate([columns.T @ left, pull[rest]])
            parts = len(more) - 1
            least, endless = size if parts else _lowest(one), np.full(parts, np.inf)
            ends = [[least], -endless, low[rest]], [[one.most], endless, high[rest]]
            step = lowest(bend, slope, *map(np.concatenate, ends))
            gain = float(slope @ step - step @ bend @ step / 2)
            best = max(best, (gain, now + float(step[0])), key=lambda pair: pair[0])
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


def _lowest(one: Parameter) -> float:
    """How far an effect's number may fall: in a linear step, a positive one by all of it."""
    if not one.kind.either_sign:
        return 0.0
    return -1.0 if one.kind.coordinate == "logarithm" else -one.most


def _sizes(one: Parameter) -> tuple[float, ...]:
    """Sizes over which an effect's slope is taken."""
    ways = (1.0, -1.0) if one.kind.either_sign else (1.0,)
    multiples = KINKS if one.kind.kinked else SIZES[: 1 if one.kind.spot else 3 - len(ways)]
    return tuple(w * min(m * one.least, one.most) for m in multiples for w in ways)
