"""Which effects may close a gap: what a linear step of all tolerances and the effect would win."""

from collections.abc import Mapping, Sequence

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.models.parameters import Parameter
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import Problem

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
    left, whole = fit.residual * weights, np.linalg.inv(curvature)

    def promise(number: int) -> tuple[float, float]:
        """What it wins of the cost, and the size that wins it."""
        one, now = fitter.parameters[number], free.get(number, 0.0)
        rest = np.array([k != number for k in problem.numbers])
        inverse = whole if rest.all() else np.linalg.inv(curvature[np.ix_(rest, rest)])
        best = 0.0, 0.0
        for size in _sizes(one):
            if (number, size) not in chords:
                moved = fitter.shown({**free, number: now + size})
                chords[number, size] = np.nan_to_num(moved - base) / size
            column = chords[number, size] * weights
            shared = jacobian[:, rest].T @ column
            bend = column @ column - shared @ inverse @ shared
            slope = column @ left - shared @ inverse @ pull[rest]
            to = np.clip(
                slope / max(bend, 1e-9), -one.most if one.kind.either_sign else 0.0, one.most
            )
            gain = float(slope * to - bend * to * to / 2)
            best = max(best, (gain, float(now + to)), key=lambda pair: pair[0])
        return best

    found = {k: promise(k) for k in effects}
    ranked = sorted(found, key=lambda k: -found[k][0])
    return {k: found[k][1] for k in ranked}, slopes


def _sizes(one: Parameter) -> tuple[float, ...]:
    """Sizes over which an effect's slope is taken."""
    ways = (1.0, -1.0) if one.kind.either_sign else (1.0,)
    multiples = KINKS if one.kind.kinked else SIZES[: 3 - len(ways)]
    return tuple(w * min(m * one.least, one.most) for m in multiples for w in ways)
