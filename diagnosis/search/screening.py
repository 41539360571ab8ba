"""Which effects may close a gap: what a linear step of all tolerances and the effect would win."""

from collections.abc import Mapping, Sequence

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.models.parameters import Parameter, with_parts
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import RIDGE, Problem

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
    left, moves = fit.residual * weights, problem.moves(fit.u, pull)
    whole = np.linalg.inv(curvature[np.ix_(moves, moves)])

    def promise(number: int) -> tuple[float, float]:
        """What it wins of the cost, and the size that wins it."""
        one, now = fitter.parameters[number], free.get(number, 0.0)
        rest = moves & np.array([k != number for k in problem.numbers])
        same = rest.sum() == len(whole)
        inverse = whole if same else np.linalg.inv(curvature[np.ix_(rest, rest)])
        best = 0.0, 0.0
        for size in _sizes(one):
            columns = np.stack(changes(number, size, now), axis=1) * weights[:, None]
            shared = (jacobian.T @ columns)[rest]
            bend = columns.T @ columns - shared.T @ inverse @ shared
            slope = columns.T @ left - shared.T @ inverse @ pull[rest]
            least = size if len(slope) > 1 else -one.most if one.kind.either_sign else 0.0
            gain, to = _won(bend, slope, least, one.most)
            best = max(best, (gain, now + to), key=lambda pair: pair[0])
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


def _won(bend: Array, slope: Array, least: float, most: float) -> tuple[float, float]:
    """What the first of n changes wins between two sizes, with the best of the others; and where.

    The cost of changes x (n,) is x'A x / 2 - g'x, with bend A (n, n) and slope g (n,).
    """
    own, along, more = float(bend[0, 0]), float(slope[0]), 0.0
    if len(slope) > 1:
        others = bend[1:, 1:] + np.diag(RIDGE * np.diag(bend)[1:] + RIDGE)
        by = np.linalg.solve(others, np.stack([bend[1:, 0], slope[1:]], axis=1))
        own -= float(bend[0, 1:] @ by[:, 0])
        along -= float(bend[0, 1:] @ by[:, 1])
        more = float(slope[1:] @ by[:, 1]) / 2
    to = np.clip(along / max(own, 1e-9), least, most)
    return float(along * to - own * to * to / 2 + more), float(to)


def _sizes(one: Parameter) -> tuple[float, ...]:
    """Sizes over which an effect's slope is taken."""
    ways = (1.0, -1.0) if one.kind.either_sign else (1.0,)
    curved = one.kind.kinked or not (one.kind.either_sign or one.kind.spot)
    multiples = SIZES if curved else SIZES[:1]
    return tuple(w * min(m * one.least, one.most) for m in multiples for w in ways)
