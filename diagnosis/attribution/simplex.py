"""A search without slopes, for joints in their play, whose motion no slope predicts."""

import numpy as np
from scipy.optimize import minimize

from backends.state import Array
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.profile import Fit, grown

TRIES = 1000
"""Worlds that are tried."""
STEP = 0.05
"""How much larger a magnitude is where a nominal parameter is a standard deviation off."""


def simplex(fitter: Fitter, fit: Fit) -> Fit:
    """A fit, or a better one by an adaptive simplex around it, magnitudes within their bounds.

    Nelder and Mead, Computer Journal 7, 1965; Gao and Han, Comp. Optimization and Applications 51,
    2012.
    """
    free = np.flatnonzero(fitter.free(fit.effects))

    def at(x: Array) -> Fit:
        deviations = np.zeros_like(fit.deviations)
        deviations[free] = x[: len(free)]
        pairs = zip(fit.effects, np.exp(STEP * x[len(free) :]), strict=True)
        return fitter.at(tuple(grown(effect, times) for effect, times in pairs), deviations)

    start = np.concatenate([fit.deviations[free], np.zeros(len(fit.effects))])
    corners = np.vstack([start, start + np.eye(len(start))])
    most = np.full(len(start), fitter.farthest)
    found = minimize(
        lambda x: at(x).cost,
        start,
        method="Nelder-Mead",
        bounds=np.column_stack([-most, most]),
        options={"maxfev": TRIES, "adaptive": True, "initial_simplex": corners},
    )
    return min(fit, at(found.x), key=lambda one: one.cost)
