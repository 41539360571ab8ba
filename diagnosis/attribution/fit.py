"""Fits of candidate worlds to evidence, with the nominal parameters free within their uncertainty.

The nominal parameters' influence is linear to first order, so for every magnitude of an effect the
best of them follow from one linear solve (variable projection; Golub and Pereyra, 1973), and only
the magnitude is searched. Searching survives what slopes do not: delays have kinks, play rattles.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.evidence import Evidence

STEP = 0.3
"""Step of a derivative by a nominal parameter, in its standard deviations."""
CURVE = 0.05
"""Relative steps of a magnitude for the curvature of its cost."""
BLOCK = 40
"""Samples in a block."""
FARTHEST = 5.0
"""Nominal parameters stay within so many standard deviations."""
CORRELATED = 10.0
"""Samples that tell as much as one: residuals of neighbouring samples resemble each other."""
SEARCHES = 7
"""Magnitudes tried in one search."""
POLISH = (1.6, 1.2, 1.05, 1.015)
"""How far around the last magnitude, as a factor, the rounds of a refit search."""


@dataclass(frozen=True, kw_only=True)
class Nuisance:
    """A nominal parameter: an effect whose magnitude is small and not asked for."""

    kind: type[Effect]
    joint: str
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
    """Half the squared residuals on the fitting samples over `CORRELATED`, plus the prior's."""

    def resized(self, index: int, magnitude: float) -> "Fit":
        """The same with another magnitude of one effect."""
        effects = list(self.effects)
        effects[index] = replace(effects[index], magnitude=float(magnitude))
        return replace(self, effects=tuple(effects))


class Fitter:
    """Fits to one limb's evidence."""

    def __init__(self, evidence: Evidence, nuisances: Sequence[Nuisance]) -> None:
        self.evidence, self.nuisances = evidence, tuple(nuisances)
        self.replays = 0

    def residual(
        self,
        effects: Iterable[Effect],
        deviations: Array,
        judged: bool | None = False,
        compress: bool = True,
    ) -> Array:
        """Residuals of a candidate, see `Evidence.residual`; by default of the fitting samples."""
        self.replays += 1
        return self.evidence.residual(self._all(effects, deviations), judged, compress)

    def unrest(self, fit: Fit) -> float:
        """See `Evidence.unrest`."""
        return self.evidence.unrest(self._all(fit.effects, fit.deviations))

    def _all(self, effects: Iterable[Effect], deviations: Array) -> list[Effect]:
        pairs = zip(self.nuisances, deviations, strict=True)
        return [*(n.at(d) for n, d in pairs if d != 0.0), *effects]

    def cost(self, effects: Iterable[Effect], deviations: Array) -> float:
        """See `Fit.cost`."""
        r = self.residual(effects, deviations)
        return float(r @ r / CORRELATED + deviations @ deviations) / 2

    def free(self, effects: Iterable[Effect]) -> Array:
        """Nominal parameters beside these effects (K,): not those that an effect itself changes."""
        taken = [(type(e), e.joint) for e in effects]
        return np.array(
            [
                not any(n.kind is k and j in (None, n.joint) for k, j in taken)
                for n in self.nuisances
            ],
            dtype=bool,
        )

    def nominal(self) -> Fit:
        """The nominal parameters refitted alone: what a calibration would reach."""
        zeros = np.zeros(len(self.nuisances))
        return self.refit(Fit(effects=(), deviations=zeros, cost=self.cost((), zeros)))

    def refit(self, fit: Fit) -> Fit:
        """Everything free, around a fit: slopes anew, then each magnitude searched, in rounds."""
        for reach in POLISH:
            profile = Profile(self, fit)
            best = self._checked(fit, profile.at(fit))
            for index in range(len(fit.effects)):
                best = self._checked(best, profile.search(best, index, reach))
            fit = best
        return fit

    def spread(self, fit: Fit, index: int) -> float:
        """Standard deviation of the logarithm of a fitted magnitude; infinite where it is free.

        From the curvature of the profile cost, in which the nominal parameters follow, and from how
        far residuals resemble their neighbours (the variance of block means over that of samples).
        """
        profile = Profile(self, fit)
        magnitude = fit.effects[index].magnitude
        costs = [
            profile.at(fit.resized(index, magnitude * factor)).cost
            for factor in (1 - CURVE, 1.0, 1 + CURVE)
        ]
        curvature = (costs[0] - 2 * costs[1] + costs[2]) / CURVE**2
        if curvature <= 0:
            return math.inf
        r = self.residual(fit.effects, fit.deviations)
        blocks = r[: len(r) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
        alike = max(1.0, BLOCK * float(np.mean(blocks**2))) * (1 + self.unrest(fit) ** 2)
        return math.sqrt(alike / CORRELATED / curvature)

    def _checked(self, fit: Fit, guess: Fit) -> Fit:
        """The guess, or half its move of nominal parameters, where that is really better."""
        for share in (1.0, 0.4, 0.1):
            deviations = fit.deviations + share * (guess.deviations - fit.deviations)
            cost = self.cost(guess.effects, deviations)
            if cost < fit.cost:
                return Fit(effects=guess.effects, deviations=deviations, cost=cost)
        return fit


class Profile:
    """Costs of effects at any magnitude, with nominal parameters at their linear best."""

    def __init__(self, fitter: Fitter, around: Fit) -> None:
        self._fitter, self._start = fitter, around.deviations
        base = fitter.residual(around.effects, self._start)
        columns = []
        for unit in STEP * np.eye(len(self._start)):
            moved = fitter.residual(around.effects, self._start + unit)
            columns.append((moved - base) / STEP)
        self._slopes = np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))
        self._normal = self._slopes.T @ self._slopes / CORRELATED + np.eye(len(columns))

    def at(self, fit: Fit) -> Fit:
        """A candidate's effects with their best nominal parameters and linear cost."""
        free = self._fitter.free(fit.effects)
        start, slopes = self._start * free, self._slopes * free
        base = self._fitter.residual(fit.effects, start)
        pull = slopes.T @ base / CORRELATED + start
        normal = np.where(np.outer(free, free), self._normal, np.eye(len(free)))
        best = start - np.linalg.solve(normal, pull)
        move = np.clip(best, -FARTHEST, FARTHEST) - start
        cost = base @ base / CORRELATED + start @ start
        cost += 2 * pull @ move + move @ normal @ move
        return Fit(effects=fit.effects, deviations=start + move, cost=float(cost / 2))

    def search(self, fit: Fit, index: int, reach: float) -> Fit:
        """The best magnitude of one effect within a factor `reach` of the one it has."""
        effect = fit.effects[index]
        sign, size = np.sign(effect.magnitude), abs(effect.magnitude)
        most = max(abs(bound) for bound in effect.bounds if bound * sign > 0)
        tried: list[Fit] = [self.at(fit)]

        def cost(log_size: float) -> float:
            tried.append(self.at(fit.resized(index, sign * np.exp(log_size))))
            return tried[-1].cost

        bounds = np.log([size / reach, min(size * reach, most)])
        if bounds[1] > bounds[0]:
            minimize_scalar(cost, bounds=bounds, method="bounded", options={"maxiter": SEARCHES})
        return min(tried, key=lambda one: one.cost)
