"""Play that rattles: a joint in its play goes its own way after the smallest change of its start.

No world with play then shows what the real one did, however right it is. So residuals are counted
in what the fit itself cannot predict, wherever that is more than a floor.
"""

from dataclasses import replace

import numpy as np

from diagnosis.evidence.gap import squared_gaps
from diagnosis.search.fit import Fit, Fitter

NUDGES_RAD = (-1e-5, -3e-6, 3e-6, 1e-5)
"""Shifts of the start that no sensor shows [rad; of a slide a share of its travel]."""


def with_prediction_spread(fitter: Fitter, fit: Fit) -> Fit:
    """The fit with gaps in units of floors and of how far its own prediction spreads."""
    here = fitter.world.shown(fit.u)
    squares = [(fitter.world.shown(fit.u, nudge) - here) ** 2 for nudge in NUDGES_RAD]
    spread = np.nan_to_num(np.mean(squares, axis=0))
    residual = fit.residual / np.sqrt(1.0 + spread)
    return replace(fit, gap2=squared_gaps(fitter.evidence, residual))
