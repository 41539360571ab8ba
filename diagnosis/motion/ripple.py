"""Where a joint's motor may cog: the period and phase that a log shows most of, before any fit.

What the nominal replay leaves is what an unknown torque on the motor moves, through the servo's
closed loop

    J r'' + (kd + viscous) r' + kp r = torque

Sines of the joint's angle, moved so, are fitted beside what gains, inertias, friction and weight
leave if they are off. The period whose sine and cosine take most of it is the one.
"""

import numpy as np
from scipy.signal import lfilter

from backends.state import Array
from diagnosis.motion.columns import ROTOR, VISCOUS
from diagnosis.motion.limb import BLOCK_S, Limb

PERIODS_RAD = (0.05, 1.0)
"""Shortest and longest period that is looked for: finer ones are a roughness, longer ones a
weight."""
STEP, FINER = 0.4, 20
"""Sines differ by so much of a radian at the ends of a joint's range; about the best, so many times
less."""
LEAST_BLOCKS = 50
"""Fewer blocks say nothing."""
AT_ONCE = 1_000_000
"""Values of sines that are moved together, of which memory holds a few copies."""


def ripples(limb: Limb) -> Array:
    """Period and phase [rad] of every joint's cogging, shape (K, 2); zeros where none is seen."""
    left = limb.measured[:, 0] - limb.simulate(limb.nominal)[:, 0]
    return np.array([_ripple(limb, j, left[:, j]) for j in range(len(limb.joints))])


def _ripple(limb: Limb, joint: int, left: Array) -> tuple[float, float]:
    """The same of one joint, of which the nominal replay leaves `left` (N,)."""
    angle, known = limb.measured[:, 0, joint], np.isfinite(left)
    span = float(np.ptp(angle[known])) if known.any() else 0.0
    if known.sum() < LEAST_BLOCKS or span < PERIODS_RAD[0]:
        return 0.0, 0.0
    base, _ = np.linalg.qr(_moved(limb, joint, _ordinary(limb, joint))[known])
    left = left[known] - base @ (base.T @ left[known])

    def taken(per_rad: Array) -> tuple[Array, Array]:
        """What each of these waves per radian (P,) takes, and its phase."""
        turns = np.nan_to_num(angle)[:, None] * per_rad
        moved = _moved(limb, joint, np.stack([np.sin(turns), np.cos(turns)]))[:, known]
        moved -= base @ (base.T @ moved)
        (ss, sc), (_, cc) = np.einsum("anp,bnp->abp", moved, moved)
        s, c = moved.transpose(0, 2, 1) @ left
        det = np.maximum(ss * cc - sc**2, 1e-12 * ss * cc)
        sine, cosine = (cc * s - sc * c) / det, (ss * c - sc * s) / det
        return sine * s + cosine * c, np.arctan2(cosine, sine)

    def best(per_rad: Array) -> tuple[float, float]:
        """The one that takes most, and its phase."""
        some = np.array_split(per_rad, -(-len(per_rad) * len(angle) // AT_ONCE))
        takes, phase = map(np.concatenate, zip(*map(taken, some), strict=True))
        k = int(np.argmax(takes))
        return float(per_rad[k]), float(phase[k])

    step, longest = 2 * STEP / span, min(PERIODS_RAD[1], span)
    coarse, _ = best(np.arange(2 * np.pi / longest, 2 * np.pi / PERIODS_RAD[0], step))
    per_rad, phase = best(coarse + step * np.linspace(-1.0, 1.0, 2 * FINER + 1))
    return 2 * np.pi / per_rad, phase


def _ordinary(limb: Limb, joint: int) -> Array:
    """Torques of what may be off by itself, up to their sizes, shape (N, 8)."""
    q = np.nan_to_num(limb.measured[:, 0, joint])
    target = np.nan_to_num(limb.means(lambda recording: recording.command)[:, joint])
    speeds, accels = list[Array](), list[Array]()
    for x, time_s in zip(limb.by_episode(q), limb.time_s, strict=True):
        speeds.append(np.gradient(x, time_s) if len(x) > 1 else np.zeros_like(x))
        accels.append(np.gradient(speeds[-1], time_s) if len(x) > 1 else np.zeros_like(x))
    v, a = np.concatenate(speeds), np.concatenate(accels)
    rows = np.ones_like(q), q, target, v, a, np.sign(v), np.sin(q), np.cos(q)
    return np.stack(rows, axis=1)


def _moved(limb: Limb, joint: int, torque: Array) -> Array:
    """What torques (..., N, P) on a motor move, an episode at a time from rest."""
    numbers = limb.nominal[joint]
    step = max(BLOCK_S, limb.period_s)
    inertia = numbers[ROTOR] + limb.link_inertia[joint]
    stiffness, kd = limb.servo[:, joint]
    damping, s = kd + numbers[VISCOUS], 2.0 / step
    # The bilinear transform of 1 / (J s^2 + d s + kp).
    low = [
        inertia * s**2 + damping * s + stiffness,
        2.0 * (stiffness - inertia * s**2),
        inertia * s**2 - damping * s + stiffness,
    ]
    parts = np.split(torque, np.cumsum(list(map(len, limb.time_s)))[:-1], axis=-2)
    return np.concatenate([lfilter([1.0, 2.0, 1.0], low, x, axis=-2) for x in parts], axis=-2)
