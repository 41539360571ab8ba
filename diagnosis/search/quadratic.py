"""The lowest point of a quadratic within bounds, by an active set."""

import numpy as np

from backends.state import Array

ROUNDS = 40
"""Changes of the active set before the best so far is taken."""
SLACK = 1e-12


def lowest(curvature: Array, slope: Array, low: Array, high: Array) -> Array:
    """The d (n,) with low <= d <= high that minimises d'A d / 2 - g'd, for A (n, n) and g (n,).

    Bounds that a free solution crosses are made active; one whose multiplier pulls inwards is
    released again, the strongest first.
    """
    pinned = np.zeros(len(slope), dtype=int)
    d = np.zeros(len(slope))
    for _ in range(ROUNDS):
        free = pinned == 0
        d = np.where(pinned < 0, low, np.where(pinned > 0, high, 0.0))
        if free.any():
            rest = slope[free] - curvature[np.ix_(free, ~free)] @ d[~free]
            d[free] = np.linalg.solve(curvature[np.ix_(free, free)], rest)
        below, above = free & (d < low - SLACK), free & (d > high + SLACK)
        if below.any() or above.any():
            pinned[below], pinned[above] = -1, 1
            continue
        pull = (slope - curvature @ d) * -pinned
        worst = int(np.argmax(pull))
        if pull[worst] <= SLACK:
            break
        pinned[worst] = 0
    return np.clip(d, low, high)
