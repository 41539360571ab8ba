"""What taxels read of how deep they are pressed: their gains, and how far they stay behind.

Geometry is off as well, but for all taxels of a finger at once. So gains are none unless they show
beside what a sample's taxels have in common. Nor is it off by the way that a press came: of
hysteresis only what changes while a taxel is pressed counts, and its mean is left out.
"""

import numpy as np
from scipy.special import ndtr

from backends.state import Array
from diagnosis.skin.forward_model import ALIKE, Faults, Pressed
from diagnosis.verdict.exact import ACCUSE_NATS

SPREADS = np.linspace(0.0, 0.95, 191)[1:]
"""How far gains may differ from 1."""
PRESSED = 5.0
"""Gains show where a taxel is pressed deeper than so many blurs."""
LEAST = 5
"""A sample tells gains apart where so many taxels of a finger are pressed."""
STRAY = 0.02
"""Share of the taxels whose gain geometry gets wrong by any amount."""
SHARES, FINER = np.linspace(0.0, 1.0, 41), np.linspace(-1.0, 1.0, 11)
"""Sizes of hysteresis that are tried, and those around the best, in steps of the first."""


def gains(data: Pressed, faults: Faults) -> tuple[Array, Array] | None:
    """How much more than 1 the gain of every taxel is, and its standard deviation, both (F, K).

    Beside a skin's other faults, of depths alone; None where gains are none. A taxel that was never
    pressed has 0 and an infinite deviation.
    """
    depth = data.eased_m(faults.hysteresis)
    pressed = (depth > PRESSED * faults.blur_m) & (data.reading > 0.0)
    pressed &= (pressed.sum(axis=2) >= LEAST)[..., None]
    if not pressed.any():
        return None
    off = data.reading - data.time_s[:, None, None] * faults.slope_m_s - depth
    together = np.ma.median(np.ma.array(off, mask=~pressed), axis=2).filled(0.0)[..., None]
    depth = np.where(pressed, depth, 0.0)
    beside = _fitted(np.where(pressed, off - together, 0.0), depth, faults.blur_m)
    if evidence(*beside).max() < ACCUSE_NATS:
        return None
    return _fitted(np.where(pressed, off, 0.0), depth, faults.blur_m)


def _fitted(off: Array, depth: Array, blur_m: float) -> tuple[Array, Array]:
    """Least squares of readings that are off at depths (S, F, K) [m], both 0 if not pressed."""
    weight = (depth**2).sum(axis=0)
    known = weight > 0.0
    divisor = np.where(known, weight, 1.0)
    more = np.where(known, (off * depth).sum(axis=0) / divisor, 0.0)
    left = (off - more * depth)[depth > 0.0]
    scatter_m = max(blur_m, float(np.sqrt(np.mean(left**2))))
    return more, np.where(known, scatter_m * np.sqrt(ALIKE / divisor), np.inf)


def evidence(more: Array, sd: Array) -> Array:
    """Log-evidence of `SPREADS` (D,) over that of none [nats]: gains are spread evenly."""
    known, most = np.isfinite(sd), SPREADS[:, None]
    more, sd = more[known], sd[known]
    inside = ndtr((most - more) / sd) - ndtr((-most - more) / sd)
    some = (1.0 - STRAY) * inside / (2.0 * most) + STRAY / 2.0
    none = np.exp(-0.5 * (more / sd) ** 2) / (np.sqrt(2.0 * np.pi) * sd)
    none = (1.0 - STRAY) * none + STRAY / 2.0
    return np.asarray((np.log(some) - np.log(none)).sum(axis=1))


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
