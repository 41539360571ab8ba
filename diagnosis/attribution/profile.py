"""Costs of effects at any magnitude, with all else at its linear best around a fit.

The nominal parameters' influence is linear to first order, and so is that of effects that are
already in the fit, so for every magnitude of one more effect the best of them follow from one
linear solve (variable projection; Golub and Pereyra, 1973), and only this magnitude is searched.
Searching survives what slopes do not: delays have kinks, play rattles.
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from backends.effect import Effect
from backends.state import Array

STEP = 0.03
"""Step of a derivative by a nominal parameter, in its standard deviations: where a joint rattles in
its play, slopes over much smaller ones are chance."""
GROW = 0.01
"""Step of a derivative by a magnitude, relative."""
LEAP = 0.7
"""One linear step changes the logarithm of a magnitude by no more."""
LOOSE = 1e-4
"""Weight of the prior of a magnitude's logarithm: it says nothing."""
SEARCHES = 7
"""Magnitudes tried in one search."""
FORETOLD, SMALL = 0.05, 3.0
"""Slopes that predict a change but for this share of its square are kept; or but for so much of it,
which is 1.5 nats."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A candidate world at its best."""

    effects: tuple[Effect, ...]
    """The effects asked for, with fitted magnitudes; empty: nominal parameters alone."""
    deviations: Array
    """Fitted nominal parameters in standard deviations, shape (K,)."""
    cost: float
    """Half the squared innovations on the samples that it was fitted on, plus the prior's."""


class Worlds(Protocol):
    """What a profile asks of a fitter."""

    @property
    def farthest(self) -> float:
        """See `Fitter.farthest`."""

    def innovations(self, effects: tuple[Effect, ...], deviations: Array) -> Array:
        """See `Fitter.innovations`."""

    def free(self, effects: tuple[Effect, ...]) -> Array:
        """See `Fitter.free`."""


class Profile:
    """Costs of effects at any magnitude, with all else at its linear best around a fit.

    What else there is: nominal parameters, and the magnitudes of effects in the fit.
    """

    def __init__(self, fitter: Worlds, around: Fit) -> None:
        self._fitter, self._around = fitter, around
        start, effects = around.deviations, around.effects
        self._base = base = fitter.innovations(effects, start)
        columns = [
            (fitter.innovations(effects, start + STEP * unit) - base) / STEP
            for unit in np.eye(len(start))
        ]
        for index, effect in enumerate(effects):
            factor = 1 + GROW
            if grown(effect, factor).magnitude == effect.magnitude:
                factor = 1 - GROW
            moved = _swapped(effects, index, grown(effect, factor))
            columns.append((fitter.innovations(moved, start) - base) / np.log(factor))
        self._slopes = np.stack(columns, axis=1) if columns else np.zeros((len(base), 0))
        self._prior = np.array([1.0] * len(start) + [LOOSE] * len(effects))
        self._normal = _products(self._slopes, self._slopes) + np.diag(self._prior)

    def moved(self, fit: Fit) -> "Profile | None":
        """The profile around another fit of these effects; None where its slopes are others.

        What the slopes did not predict goes into them (Broyden, 1965), to each parameter by what
        its part of the step weighs.
        """
        pairs = zip(fit.effects, self._around.effects, strict=True)
        ratios = [a.magnitude / b.magnitude for a, b in pairs]
        if any(ratio <= 0 for ratio in ratios):
            return None
        step = np.concatenate([fit.deviations - self._around.deviations, np.log(ratios)])
        other = copy(self)
        other._around, other._base = fit, self._fitter.innovations(fit.effects, fit.deviations)
        change = other._base - self._base
        missed = change - self._slopes @ step
        if missed @ missed > max(FORETOLD * (change @ change), SMALL):
            return None
        weighed = np.diag(self._normal) * step
        if step.any():
            other._slopes = self._slopes + np.outer(missed, weighed / (weighed @ step))
            other._normal = _products(other._slopes, other._slopes) + np.diag(self._prior)
        return other

    def at(self, effects: tuple[Effect, ...], held: int | None = None, damping: float = 0.0) -> Fit:
        """These effects with the best of all else and the linear cost.

        The first of them are those of the fit around, one of which, `held`, may have another
        magnitude and keeps it; those beyond keep theirs.
        """
        around, fitter = self._around, self._fitter
        count, given = len(around.deviations), len(around.effects)
        free = fitter.free(effects)
        start = around.deviations * free
        loose = np.array([*free, *(index != held for index in range(given))], dtype=bool)
        base = fitter.innovations(effects, start)
        pull = _products(self._slopes, base[:, None])[:, 0] * loose
        pull[:count] += self._prior[:count] * start
        normal = self._normal
        low = np.concatenate([-fitter.farthest - start, np.full(given, -LEAP)]) * loose
        high = np.concatenate([fitter.farthest - start, np.full(given, LEAP)]) * loose
        move = _lowest(normal + damping * np.diag(np.diag(normal)), pull, low, high)
        cost = base @ base + start @ start + 2 * pull @ move + move @ normal @ move
        moved = tuple(
            grown(e, np.exp(move[count + k])) if k < given and k != held else e
            for k, e in enumerate(effects)
        )
        return Fit(effects=moved, deviations=start + move[:count], cost=float(cost / 2))

    def pulled(self, moved: Array) -> Array:
        """How the logarithms of all magnitudes move when innovations do so (n,), to first order."""
        given = len(self._around.effects)
        free = np.array([*self._fitter.free(self._around.effects), *([True] * given)])
        normal, pull = self._normal[np.ix_(free, free)], _products(self._slopes, moved[:, None])
        return -np.linalg.solve(normal, pull[free, 0])[free.sum() - given :]

    def search(self, effects: tuple[Effect, ...], index: int, reach: float) -> Fit:
        """The best magnitude of one effect within a factor `reach` of the one it has.

        Effects of the fit around, other than this one, start from there.
        """
        effect, given = effects[index], self._around.effects
        effects = (*(effects[k] if k == index else e for k, e in enumerate(given)),) + effects[
            len(given) :
        ]
        sign, size = np.sign(effect.magnitude), abs(effect.magnitude)
        most = max(abs(bound) for bound in effect.bounds if bound * sign > 0)
        tried: list[Fit] = [self.at(effects, index)]

        def cost(log_size: float) -> float:
            moved = replace(effect, magnitude=float(sign * min(np.exp(log_size), most)))
            tried.append(self.at(_swapped(effects, index, moved), index))
            return tried[-1].cost

        bounds = np.log([size / reach, min(size * reach, most)])
        if bounds[1] > bounds[0]:
            minimize_scalar(cost, bounds=bounds, method="bounded", options={"maxiter": SEARCHES})
        return min(tried, key=lambda one: one.cost)


def grown(effect: Effect, factor: float) -> Effect:
    """An effect so many times as large, within its bounds."""
    low, high = effect.bounds
    return replace(effect, magnitude=float(np.clip(effect.magnitude * factor, low, high)))


def _lowest(normal: Array, pull: Array, low: Array, high: Array) -> Array:
    """The move m of least pull m + m normal m / 2 within bounds (K,), which stop it one by one."""
    move, free = np.zeros(len(pull)), low < high
    while True:
        held = pull + normal @ (move * ~free)
        move[free] = -np.linalg.solve(normal[np.ix_(free, free)], held[free])
        inside = np.clip(move, low, high)
        if (inside == move).all():
            return move
        move, free = inside, free & (inside == move)


def _products(a: Array, b: Array) -> Array:
    """Products of columns, (n, A) and (n, B) to (A, B); BLAS would wake a thread per core."""
    return np.einsum("na,nb->ab", a, b)


def _swapped(effects: tuple[Effect, ...], index: int, effect: Effect) -> tuple[Effect, ...]:
    return (*effects[:index], effect, *effects[index + 1 :])
