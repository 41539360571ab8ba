"""How far readings stay behind where a press eases, from depths.

Geometry is off as well, but not by the way that a press came. So only what changes while a taxel is
pressed counts: its mean is left out.
"""

import numpy as np

from backends.state import Array
from diagnosis.skin.forward_model import ALIKE, Faults, Pressed
from diagnosis.skin.gains import PRESSED
from diagnosis.verdict.exact import ACCUSE_NATS
from diagnosis.verdict.result import CLOSE_NATS

SHARES, FINER = np.linspace(0.0, 1.0, 41), np.linspace(-1.0, 1.0, 11)
"""Sizes that are tried, and those around the best, in steps of the first."""


def hysteresis(data: Pressed, faults: Faults) -> tuple[float, float, float] | None:
    """The best size beside a skin's other faults, and its interval; None where it is none."""
    if not data.history:
        return None
    base = _squares(data, faults, SHARES)
    near = float(SHARES[int(np.argmin(base))])
    sizes = np.clip(near + (SHARES[1] - SHARES[0]) * FINER, 0.0, 1.0)
    squares, count = _squares(data, faults, sizes), _count(data, faults)
    variance = max(faults.blur_m**2, float(squares.min()) / max(count, 1))
    nats = -squares / (2.0 * variance * ALIKE)
    best = int(np.argmax(nats))
    if nats[best] + base[0] / (2.0 * variance * ALIKE) < ACCUSE_NATS:
        return None
    good = sizes[nats > nats[best] - CLOSE_NATS]
    half = (sizes[-1] - sizes[0]) / (2 * len(sizes))
    return float(sizes[best]), float(good[0]) - half, float(good[-1]) + half


def _where(data: Pressed, faults: Faults) -> Array:
    """Where a press shows, (S, F, K)."""
    pressed = data.eased_m(0.0) > PRESSED * faults.blur_m
    return np.asarray(pressed & (data.reading > 0.0))


def _count(data: Pressed, faults: Faults) -> int:
    return int(_where(data, faults).sum())


def _squares(data: Pressed, faults: Faults, sizes: Array) -> Array:
    """What is left at sizes (D,), without the means of the taxels, squared and summed [m^2]."""
    pressed = _where(data, faults)
    counts = np.maximum(pressed.sum(axis=0), 1)
    read = data.reading - data.time_s[:, None, None] * faults.slope_m_s
    found = []
    for size in sizes:
        left = np.where(pressed, read - faults.gain * data.eased_m(float(size)), 0.0)
        found.append(np.sum(left**2) - np.sum(left.sum(axis=0) ** 2 / counts))
    return np.array(found)
