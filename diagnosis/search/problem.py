"""What a fit varies: tolerances under their priors, and effects that are free within bounds."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from backends.state import Array
from diagnosis.models.parameters import Parameter, bounds, with_parts
from diagnosis.motion.columns import PLAY

REACH = 2.5
"""A tolerance ends at so many standard deviations: no healthy robot is further off."""
SOFT = 5.0
"""A gear with play may twist so many times more than others."""
WIDE = 1e3
"""An effect's size has a prior so many times wider than its bounds: none."""
RIDGE = 1e-9
"""Relative: keeps normal equations regular where two parameters do the same."""
EXACT = 1e-12
"""A step wins all but this share of what it can."""
ROUNDS = 12
"""Of an active set, which mostly takes two or three."""
AT_ONCE = 20_000
"""So many readings are weighted at a time: all of a long log would take as much as its slopes."""
STRIDE, GROWTH = 3.0, 0.7
"""A step moves a tolerance by so many standard deviations at most, an effect by so many of its
least sizes or this share of what it is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """The parameters of a fit by number, with priors and bounds, all (n,)."""

    numbers: tuple[int, ...]
    is_free: Array
    sd: Array
    centre: Array
    low: Array
    high: Array
    least: Array

    @classmethod
    def of(
        cls,
        parameters: Sequence[Parameter],
        freed: Sequence[int],
        moving: Collection[int] | None = None,
    ) -> "Problem":
        """All tolerances and freed effects, or those with the numbers `moving`."""
        shared = {parameters[k].effect for k in freed if parameters[k].joint is None}
        held = [k for k, p in enumerate(parameters) if _is_held(k, p, freed, shared)]
        some = None if moving is None else with_parts(parameters, moving)
        numbers = [k for k in (*held, *freed) if some is None or k in some]
        chosen = [parameters[k] for k in numbers]
        is_free = np.array([k in freed for k in numbers])
        plays = {parameters[k].joint for k in freed if parameters[k].place == PLAY}
        soft = [p.kind.coordinate == "compliance" and p.joint in plays for p in chosen]
        more = np.where(soft, SOFT, 1.0)
        triples = zip(chosen, is_free, REACH * more, strict=True)
        low, high = np.array([bounds(*one) for one in triples]).reshape(-1, 2).T
        sd = more * [p.tolerance for p in chosen]
        return cls(
            numbers=tuple(numbers),
            is_free=is_free,
            sd=np.where(is_free, WIDE * np.array([p.most for p in chosen]), sd),
            centre=np.where(is_free, 0.0, [p.centre for p in chosen]),
            low=low,
            high=high,
            least=np.array([p.least for p in chosen]),
        )

    def at(self, u: Mapping[int, float]) -> Array:
        """The parameters' sizes (n,)."""
        return np.array([u.get(k, 0.0) for k in self.numbers])

    def put(self, u: Mapping[int, float], sizes: Array) -> dict[int, float]:
        """All parameters by number, these at `sizes` (n,) within their bounds."""
        inside = np.clip(sizes, self.low, self.high)
        return {**u, **dict(zip(self.numbers, map(float, inside), strict=True))}

    def prior(self, u: Mapping[int, float]) -> float:
        """Their share of the cost."""
        return float((((self.at(u) - self.centre) / self.sd) ** 2).sum()) / 2

    def largest_step(self, u: Array) -> Array:
        """How far a step may go (n,)."""
        free = np.maximum(GROWTH * np.abs(u), STRIDE * self.least)
        return np.where(self.is_free, free, STRIDE * self.sd)

    def jacobian(self, slopes: Mapping[int, Array], weights: Array) -> Array:
        """The weighted slopes (M, n)."""
        found = np.empty((len(weights), len(self.numbers)))
        for column, k in zip(found.T, self.numbers, strict=True):
            np.multiply(slopes[k], weights, out=column)
        return found

    def normal(
        self, slopes: Mapping[int, Array], weights: Array, residual: Array, u: Mapping[int, float]
    ) -> tuple[Array, Array]:
        """What a step d from u costs is d'A d / 2 - g'd: A (n, n) and g (n,)."""
        curvature, pull = np.diag(self.sd**-2.0), -(self.at(u) - self.centre) / self.sd**2
        for begin in range(0, len(weights), AT_ONCE):
            some = slice(begin, begin + AT_ONCE)
            jacobian = self.jacobian({k: slopes[k][some] for k in self.numbers}, weights[some])
            curvature += jacobian.T @ jacobian
            pull += jacobian.T @ (residual * weights)[some]
        return curvature + RIDGE * np.diag(np.diag(curvature)), pull


def _is_held(number: int, one: Parameter, freed: Sequence[int], shared: Collection[str]) -> bool:
    """Whether it is a tolerance, or belongs to the law of a freed effect.

    A little of what all joints share is no joint's own: no fit tells these apart.
    """
    acts = one.part_of is None or one.part_of in freed
    own = one.effect not in shared or (one.kind.nominal and not one.kind.unsaid)
    return one.tolerance > 0.0 and number not in freed and acts and (own or one.part_of is not None)


def lowest(curvature: Array, slope: Array, low: Array, high: Array) -> Array:
    """The d (n,) with low <= d <= high that minimises d'A d / 2 - g'd, for A (n, n) and g (n,).

    By a primal-dual active set (Hintermueller, Ito, Kunisch 2002), which may cycle; then by BVLS.
    """
    below, above = np.zeros((2, len(slope)), dtype=bool)
    for _ in range(ROUNDS):
        free, d = ~(below | above), np.where(below, low, np.where(above, high, 0.0))
        pull = (slope - curvature @ d)[free]
        d[free] = np.linalg.solve(curvature[np.ix_(free, free)], pull)
        push = slope - curvature @ d
        before = below, above
        below = np.where(free, d < low, below & (push < 0.0))
        above = np.where(free, d > high, above & (push > 0.0))
        if np.array_equal(before, (below, above)):
            return d
    root = cholesky(curvature, lower=True)
    aim = solve_triangular(root, slope, lower=True)
    return np.asarray(lsq_linear(root.T, aim, (low, high), method="bvls", tol=EXACT).x)
