"""Where an end stop may stand in a joint's way: where it falls short of what its drive reaches.

Beside the nominal replay x of a log's commands, a joint that a stop at s holds reads

    y = s + r (x - s),    r = kp / (kp + k)       where x is beyond s

at rest, with the servo's gain kp and the stop's stiffness k.
"""

from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.motion.columns import LIMIT
from diagnosis.motion.limb import BLOCK_S, Limb

HELD, STILL_HZ = 0.3, 0.05
"""A joint is held that falls short by this share of the most, and moves by less than this share of
its range in a second."""
LEAST_BLOCKS, SPAN = 5, 0.2
"""The stiffness shows in so many blocks where it is held, whose x differ by this share of the most
that it falls short."""
YIELDS = (1e-3, 0.5)
"""Least and largest r that are taken."""


@dataclass(frozen=True, kw_only=True)
class Blocked:
    """One joint, on the side where it falls short more."""

    side: float
    """1: upwards, -1: downwards."""
    inside_rad: float
    """How far inside of that end of its range the nominal replay ends [rad]."""
    short_rad: float
    """By how much the joint falls short of that [rad]."""
    stiffness_nm_rad: float
    """What the stop would have [Nm/rad]; 0: the log does not show it."""


def blocked(limb: Limb) -> tuple[Blocked, ...]:
    """How far every joint falls short of the nominal replay."""
    shown, read = limb.simulate(limb.nominal)[:, 0], limb.measured[:, 0]
    return tuple(_blocked(limb, j, shown[:, j], read[:, j]) for j in range(len(limb.joints)))


def _blocked(limb: Limb, joint: int, shown: Array, read: Array) -> Blocked:
    known = np.isfinite(shown) & np.isfinite(read)
    if known.sum() < LEAST_BLOCKS:
        return Blocked(side=1.0, inside_rad=0.0, short_rad=0.0, stiffness_nm_rad=0.0)
    x, y = shown[known], read[known]
    side = 1.0 if x.max() - y.max() >= y.min() - x.min() else -1.0
    x, y = side * x, side * y
    low, high = limb.spec.hand.driven[joint].joint.range_rad
    end = high if side > 0.0 else -low
    short = float(x.max() - y.max())
    rate_s = np.abs(np.gradient(y)) / max(BLOCK_S, limb.period_s)
    held = (x - y > HELD * short) & (rate_s < STILL_HZ * np.ptp(y))
    kp, limit = float(limb.servo[0, joint]), float(limb.nominal[joint, LIMIT])
    held &= kp * (x - y) < limit  # beyond, the limit holds it where it is
    stiffness = 0.0
    if held.sum() >= LEAST_BLOCKS and np.ptp(x[held]) > SPAN * short:
        yields = float(np.clip(np.polyfit(x[held], y[held], 1)[0], *YIELDS))
        stiffness = kp * (1.0 / yields - 1.0)
    return Blocked(
        side=side,
        inside_rad=max(end - float(x.max()), 0.0),
        short_rad=short,
        stiffness_nm_rad=stiffness,
    )
