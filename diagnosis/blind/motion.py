"""The commands of a blind case: short random motions, different from the tuning protocols.

All joints move at once, each with its own timing, from rest in the centre of its range.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array, InitialState
from diagnosis.blind.rigs import RATE_HZ
from diagnosis.motion.batch import at_rest

LENGTH_S = 3.0
REST_S = 0.15
"""Rest before the first motion [s]."""
STEP_S, STEP_SHARES = (0.2, 0.5), (0.02, 0.45)
"""Duration of a level, and its height as a share of the range."""
TRIANGLE_SHARE, TRIANGLE_HZ = (0.15, 0.35), (0.4, 0.9)
SINES, SINE_HZ, SINE_SHARE = 7, (0.4, 10.0), (0.12, 0.25)
PUSH_SHARES = (0.12, 0.35)
"""Known pushes, as shares of the torque limit."""
HOLD_SHARE = 0.3
"""Largest position at which a joint is held under a push, as a share of the range."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One episode of T samples."""

    protocol: str
    target_rad: Array
    """Targets from each sample on [rad], shape (T, J)."""
    push_nm: Array
    """External torques from each sample on [Nm], shape (T, J)."""
    start: InitialState
    """Start of joints and stick of the single world."""
    pull_n: Array | None = None
    """Force on the stick along its axis, towards its lower end [N], shape (T,); None: none."""


def times_s(rate_hz: float = RATE_HZ) -> Array:
    """Times of the samples [s], shape (T,)."""
    return np.arange(round(LENGTH_S * rate_hz) + 1) / rate_hz


def center_rad(spec: Spec) -> Array:
    """Start of every episode [rad], shape (J,)."""
    return np.array([np.mean(b.joint.range_rad) for b in spec.hand.driven])


def motion(protocol: str, spec: Spec, rng: np.random.Generator, rate_hz: float = RATE_HZ) -> Motion:
    """A random episode of a protocol for every joint of a rig."""
    inside = np.maximum(times_s(rate_hz) - REST_S, 0.0)
    room = np.array([np.ptp(b.joint.range_rad) / 2 for b in spec.hand.driven])
    limit = np.array([drive.torque_limit_nm for drive in spec.drives])
    pairs = [MOTIONS[protocol](inside, rng) for _ in room]
    moved, pushed = (np.stack(rows, axis=1) for rows in zip(*pairs, strict=True))
    return Motion(
        protocol=protocol,
        target_rad=center_rad(spec) + room * moved,
        push_nm=limit * pushed,
        start=at_rest(center_rad(spec)[None]),
    )


def _steps(inside_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Levels of random height, small and large alike, each held for a random time."""
    count = int(LENGTH_S / STEP_S[0]) + 1
    ends = np.cumsum(rng.uniform(*STEP_S, count))
    levels = rng.choice([-1.0, 1.0], count) * evenly(rng, STEP_SHARES, count)
    moved = levels[np.searchsorted(ends, inside_s, side="right")] * (inside_s > 0)
    return moved, 0.0 * moved


def _triangle(inside_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Strokes at constant speed between reversals."""
    size = rng.choice([-1.0, 1.0]) * rng.uniform(*TRIANGLE_SHARE)
    wave = np.arcsin(np.sin(2 * np.pi * rng.uniform(*TRIANGLE_HZ) * inside_s)) * 2 / np.pi
    return size * wave, 0.0 * wave


def _multisine(inside_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Sines of random frequency and equal speed."""
    moved = 0.0 * inside_s
    for hz in evenly(rng, SINE_HZ, SINES):
        phase = rng.uniform(0, 2 * np.pi)
        moved += (np.sin(2 * np.pi * hz * inside_s + phase) - np.sin(phase)) / hz
    return moved * rng.uniform(*SINE_SHARE) / np.abs(moved).max(), 0.0 * moved


def _push(inside_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Hold a position; a known torque comes and goes, one way and then the other."""
    held = rng.uniform(-HOLD_SHARE, HOLD_SHARE) * np.clip(inside_s / 0.3, 0, 1)
    start = 0.45 + rng.uniform(0, 0.2)
    pushed = sum(
        sign * rng.uniform(*PUSH_SHARES) * _trapezoid(inside_s - start - 1.1 * k)
        for k, sign in enumerate(rng.permutation([-1.0, 1.0]))
    )
    return held, pushed + 0.0 * held


def evenly(rng: np.random.Generator, ends: tuple[float, float], count: int) -> Array:
    """Random numbers between two ends, uniform in their logarithm."""
    return np.exp(rng.uniform(math.log(ends[0]), math.log(ends[1]), count))


def _trapezoid(since_s: Array) -> Array:
    """Up in 0.3 s, on for 0.3 s, down in 0.3 s."""
    return np.clip(np.minimum(since_s, 0.9 - since_s) / 0.3, 0, 1)


MOTIONS: dict[str, Callable[[Array, np.random.Generator], tuple[Array, Array]]] = {
    "steps": _steps,
    "triangle": _triangle,
    "multisine": _multisine,
    "push": _push,
}
PROTOCOLS = tuple(MOTIONS)
