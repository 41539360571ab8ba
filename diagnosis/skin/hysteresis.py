"""How far readings stay behind where a press eases, from depths.

Geometry is off as well, but not by the way that a press came. So only what changes while a taxel is
pressed counts: its mean is left out.
"""

import numpy as np

from backends.state import Array
from diagnosis.skin.forward_model import ALIKE, Faults, Pressed
from diagnosis.skin.gains import PRESSED
from diagnosis.verdict.exact import ACCUSE_NATS

SHARES, FINER = np.linspace(0.0, 1.0, 41), np.linspace(-1.0, 1.0, 11)
"""Sizes that are tried, and those around the best, in steps of the first."""


def hysteresis(data: Pressed, faults: Faults) -> tuple[Array, Array] | None:
    """Sizes and their log-likelihoods beside a skin's other faults; None where it is none."""
    if not data.history:
        return None
    pressed = (data.eased_m(0.0) > PRESSED * faults.blur_m) & (data.reading > 0.0)
    base = _squares(data, faults, pressed, SHARES)
    near = SHARES[int(np.argmin(base))]
    sizes = np.unique(np.clip(near + (SHARES[1] - SHARES[0]) * FINER, 0.0, 1.0))
    squares = _squares(data, faults, pressed, sizes)
    variance = max(faults.blur_m**2, float(squares.min()) / max(int(pressed.sum()), 1))
    nats = (base[0] - squares) / (2.0 * variance * ALIKE)
    return None if nats.max() < ACCUSE_NATS else (sizes, nats)


def _squares(data: Pressed, faults: Faults, pressed: Array, sizes: Array) -> Array:
    """What is left at sizes (D,), without the means of the taxels, squared and summed [m^2]."""
    counts = np.maximum(pressed.sum(axis=0), 1)
    read = data.reading - data.time_s[:, None, None] * faults.slope_m_s
    found = []
    for size in sizes:
        left = np.where(pressed, read - faults.gain * data.eased_m(float(size)), 0.0)
        found.append(np.sum(left**2) - np.sum(left.sum(axis=0) ** 2 / counts))
    return np.array(found)
