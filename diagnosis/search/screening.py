"""Which effects may close a gap: what a linear step of all tolerances and the effect would win."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.evidence.gap import root_weights
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import Problem

SIZES = (2.0, 6.0)
"""Multiples of the least size over which an effect's slope is taken."""
KINKS = (3.0, 12.0, 40.0)
"""The same of an effect whose law has a kink."""


@dataclass(frozen=True, kw_only=True)
class Screened:
    """What an effect promises."""

    number: int
    gain: float
    """Of the cost."""
    to: float
    """The size that wins it."""


class Screening:
    """The linear step from a fit, ready to take one more effect at a time."""

    def __init__(self, fitter: Fitter, fit: Fit) -> None:
        self.fitter, self.fit = fitter, fit
        self.free = {k: v for k, v in fit.u.items() if not fitter.is_column(k, fit.freed)}
        self.base = fitter.world.shown(self.free)
        problem = Problem.of(fitter.parameters, fit.freed, {}, None)
        self.numbers = problem.numbers
        unknown = [k for k in self.numbers if k not in fit.slopes]
        fresh = fitter.slopes(unknown, fit.u, fit.freed, self.base)
        self.slopes = {**fit.slopes, **fresh}
        self.weights = root_weights(fitter.evidence, fit.residual)
        self.left = fit.residual * self.weights
        given = self.slopes, self.weights, fit.residual, fit.u
        self.jacobian, self.curvature, self.pull = problem.normal(*given)

    def screened(self, numbers: Sequence[int]) -> list[Screened]:
        """The effects by what they promise, the best first."""
        whole = np.linalg.inv(self.curvature)
        found = [self._one(k, whole) for k in numbers]
        return sorted(found, key=lambda one: -one.gain)

    def _one(self, number: int, whole: Array) -> Screened:
        """An effect stands in place of its own tolerance."""
        one, now = self.fitter.parameters[number], self.free.get(number, 0.0)
        rest = np.array([k != number for k in self.numbers])
        inverse = whole if rest.all() else np.linalg.inv(self.curvature[np.ix_(rest, rest)])
        best = Screened(number=number, gain=0.0, to=0.0)
        for size in self._sizes(number):
            moved = self.fitter.world.shown({**self.free, number: now + size})
            column = np.nan_to_num(moved - self.base) / size * self.weights
            shared = self.jacobian[:, rest].T @ column
            curvature = column @ column - shared @ inverse @ shared
            pull = column @ self.left - shared @ inverse @ self.pull[rest]
            to = np.clip(pull / max(curvature, 1e-9), -one.most, one.most)
            to = to if one.either_sign else max(to, 0.0)
            gain = float(pull * to - curvature * to * to / 2)
            if gain > best.gain:
                best = Screened(number=number, gain=gain, to=float(now + to))
        return best

    def _sizes(self, number: int) -> tuple[float, ...]:
        one = self.fitter.parameters[number]
        ways = (1.0, -1.0) if one.either_sign else (1.0,)
        multiples = KINKS if one.kind.kinked else SIZES[: 3 - len(ways)]
        return tuple(w * min(m * one.least, one.most) for m in multiples for w in ways)
