"""Excitation protocols: targets and known pushes that make effects distinguishable in a log.

They are pure functions of joint numbers, rate and seed, and know no hand and no engine. Row k is
commanded from `t_s[k]` until the next row. All joints move at once, each with its own step times,
periods and frequencies. So one episode serves all joints, and their effects can be separated. Every
episode starts and ends at rest in the centre of the ranges.

What each protocol shows: small steps show stiction, dead zone and resolution; large steps show
torque limits, rate limits and delays. The slow triangle shows play and friction at its reversals.
The multisine shows gains, inertias and damping. The push shows the gear, its self-lock and the
scale of all torques. With the stick in the hand, the grasp shows touch and contact, and the pull
shows the stick's mass and friction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.spec import Hand

Array = np.ndarray

RATE_HZ = 200.0
LEAD_S = 0.25
"""Rest before the first and after the last motion [s]."""
STEP_S = 0.5
STEP_SHARES = (0.01, 0.03, 0.08, 0.2, 0.45)
"""Heights of the steps, in both directions, as shares of the range about the centre."""
TRIANGLE_SHARE, TRIANGLE_S = 0.3, 11.0
"""Amplitude; length of all strokes [s]."""
TRIANGLE_CYCLES = (1.0, 1.5, 2.0, 2.5)
"""Periods of the joints, used in order."""
TRIANGLE_LATE = 1 / 50
"""Delay of each joint's start, as a share of all strokes, so that no two joints of our hand reverse
at once."""
SINES_HZ = (0.2, 0.4, 0.7, 1.2, 2.0, 3.3, 5.5, 9.0)
SINE_SHARE, SINE_S = 0.25, 10.0
"""Largest excursion, and the episode's length, which is the common period of all sines [s]."""
SAMPLES_PER_SINE = 8
"""Sines with fewer samples per period are left out."""
PUSH_LEVELS = (0.0, 0.3, -0.3)
PUSH_SHARES = (0.12, 0.22, 0.35)
"""Positions that are held, and pushes as shares of the drive's limit; each joint has its own order.

A drive with half of its torque still holds these pushes; beyond its torque the joint would be
pushed away.
"""
RAMP_S, PRESS_S = 0.3, 0.2
GRASP_RAD = 0.03
"""Amplitude of the motion with the stick in the hand [rad]."""
GRASP_HZ, GRASP_S = (0.3, 0.7, 1.3), 6.0
GRIP_S, LATE_S = 1.0, 0.1
"""Time for which the stick is held before it is pulled, and the largest random addition [s]."""
PULL_N_S, PULL_N = 100.0, 60.0
"""Rate of the pull and its largest force, if the stick does not slip before [N/s, N]. It is fast
enough that the stick's mass shows more than the change of friction on the way."""


@dataclass(frozen=True, kw_only=True)
class Joints:
    """The joint data that an excitation needs; for linear joints read m for rad and N for Nm."""

    names: tuple[str, ...]
    center_rad: Array
    """Centre of the motion [rad], shape (J,)."""
    range_rad: Array
    """Lowest and highest target [rad], shape (J, 2)."""
    limit_nm: Array
    """Largest drive torque [Nm], shape (J,); pushes are shares of it."""

    @property
    def room_rad(self) -> Array:
        """Largest excursion of each joint in both directions [rad], shape (J,)."""
        low, high = self.range_rad.T
        return np.minimum(self.center_rad - low, high - self.center_rad)


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """One open-loop episode of T samples."""

    protocol: str
    t_s: Array
    """Times [s], shape (T,)."""
    target_rad: Array
    """Targets [rad], shape (T, J), within the ranges."""
    push_nm: Array
    """External torque on each joint [Nm], shape (T, J)."""
    pull_n: Array
    """Force on the stick along its axis, towards its lower end [N], shape (T,)."""

    def alone(self, joint: int) -> "Excitation":
        """The same excitation for one joint; the others are held at their start."""
        others = np.arange(self.target_rad.shape[1]) != joint
        return replace(
            self,
            target_rad=np.where(others, self.target_rad[0], self.target_rad),
            push_nm=np.where(others, 0.0, self.push_nm),
        )


def hand_joints(hand: Hand) -> Joints:
    """The joints of a hand, about the middle of their ranges."""
    ranges = np.array([body.joint.range_rad for body in hand.driven])
    limits = [b.joint.drive.torque_limit_nm for b in hand.driven if b.joint.drive is not None]
    return Joints(
        names=hand.joint_names,
        center_rad=ranges.mean(axis=1),
        range_rad=ranges,
        limit_nm=np.array(limits),
    )


def steps(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Steps from the centre and back, of all heights in both directions, in random order.

    Within a period the joints step one after the other; each is held until its next step.
    """
    rng = np.random.default_rng([seed, 1])
    heights = np.array([*STEP_SHARES, *(-np.array(STEP_SHARES))])
    orders = np.stack([rng.permutation(heights) for _ in joints.names])
    levels = np.zeros((len(joints.names), 2 * len(heights) + 1))
    levels[:, :-1:2] = orders * joints.room_rad[:, None]
    stagger = STEP_S * np.arange(len(joints.names)) / len(joints.names)
    t = _times(2 * LEAD_S + STEP_S * (levels.shape[1] + 1), rate_hz)
    which = np.floor((t[:, None] - LEAD_S - stagger) / STEP_S).astype(int)
    moved = np.take_along_axis(levels, np.clip(which, 0, levels.shape[1] - 1).T, axis=1).T
    return _about(joints, "steps", t, np.where(which < 0, 0.0, moved))


def triangle(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Slow strokes at constant speed between two reversals; every joint has its own period."""
    signs = np.random.default_rng([seed, 2]).choice([-1.0, 1.0], len(joints.names))
    number = np.arange(len(joints.names))
    cycles = np.array(TRIANGLE_CYCLES)[number % len(TRIANGLE_CYCLES)]
    late_s = TRIANGLE_LATE * TRIANGLE_S * number
    t = _times(2 * LEAD_S + TRIANGLE_S + late_s[-1], rate_hz)
    done = np.clip((t[:, None] - LEAD_S - late_s) / TRIANGLE_S, 0, 1)
    wave = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * cycles * done))
    return _about(joints, "triangle", t, TRIANGLE_SHARE * joints.room_rad * signs * wave)


def multisine(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Sines of constant speed amplitude; no two joints share a frequency."""
    sines_hz = [f for f in SINES_HZ if f <= rate_hz / SAMPLES_PER_SINE]
    t = _times(2 * LEAD_S + SINE_S, rate_hz)
    rng = np.random.default_rng([seed, 3])
    moved = _sines(t, sines_hz, SINE_S, len(joints.names), rng, lambda cycles: 1 / cycles)
    return _about(joints, "multisine", t, SINE_SHARE * joints.room_rad * moved)


def push(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Hold some positions; at each a known torque is ramped up and down in both directions."""
    rng = np.random.default_rng([seed, 4])
    signs = rng.choice([-1.0, 1.0], len(joints.names))
    shares = np.stack([rng.permutation(PUSH_SHARES) for _ in joints.names])
    levels = np.stack([np.append(rng.permutation(PUSH_LEVELS), 0.0) for _ in joints.names])
    one_way = 2 * RAMP_S + PRESS_S
    station_s = 2 * LEAD_S + 2 * one_way + RAMP_S
    stagger = RAMP_S * np.arange(len(joints.names)) / len(joints.names)
    t = _times(2 * LEAD_S + station_s * len(PUSH_LEVELS) + 2 * RAMP_S, rate_hz)
    clock = t[:, None] - LEAD_S - stagger
    station = np.floor(clock / station_s).astype(int)
    there = (station >= 0) & (station < len(PUSH_LEVELS))
    k = np.clip(station, 0, len(PUSH_LEVELS) - 1)
    within = clock - station * station_s - LEAD_S - RAMP_S
    shape = _press(within) - _press(within - one_way)
    load = np.where(there, np.take_along_axis(shares, k.T, axis=1).T * shape, 0.0)
    knots = LEAD_S + station_s * np.arange(len(PUSH_LEVELS) + 1)
    pairs = zip(stagger, levels, strict=True)
    held = np.stack([_stairs(t - s, knots, level) for s, level in pairs], axis=1)
    moved = _about(joints, "push", t, held * joints.room_rad)
    return replace(moved, push_nm=signs * load * joints.limit_nm)


def grasp(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Small motions with the stick in the hand: slow sines of every joint about the grip."""
    t = _times(2 * LEAD_S + GRASP_S, rate_hz)
    rng = np.random.default_rng([seed, 5])
    moved = _sines(t, GRASP_HZ, GRASP_S, len(joints.names), rng, lambda cycles: 1.0)
    return _about(joints, "grasp", t, np.minimum(GRASP_RAD, joints.room_rad) * moved)


def pull(joints: Joints, rate_hz: float = RATE_HZ, seed: int = 0) -> Excitation:
    """Hold the stick still and pull it out of the grip along its axis with growing force."""
    t = _times(GRIP_S + PULL_N / PULL_N_S, rate_hz)
    held = _about(joints, "pull", t, np.zeros((len(t), len(joints.names))))
    begins_s = GRIP_S + np.random.default_rng([seed, 6]).uniform(0.0, LATE_S)
    return replace(held, pull_n=PULL_N_S * np.maximum(t - begins_s, 0.0))


FREE: dict[str, Callable[..., Excitation]] = {
    "steps": steps,
    "triangle": triangle,
    "multisine": multisine,
    "push": push,
}
"""Protocols without a stick in the hand."""
OPEN_LOOP = {**FREE, "grasp": grasp, "pull": pull}
PROTOCOLS = (*OPEN_LOOP, "policy")
"""All protocols. 'policy' is closed loop, so it has no trajectory of its own."""


def _about(joints: Joints, protocol: str, t_s: Array, moved_rad: Array) -> Excitation:
    target = joints.center_rad + moved_rad
    return Excitation(
        protocol=protocol,
        t_s=t_s,
        target_rad=target,
        push_nm=np.zeros_like(target),
        pull_n=np.zeros(len(t_s)),
    )


def _times(length_s: float, rate_hz: float) -> Array:
    return np.arange(round(length_s * rate_hz) + 1) / rate_hz


def _sines(
    t_s: Array,
    wanted_hz: Sequence[float],
    length_s: float,
    joints: int,
    rng: np.random.Generator,
    height: Callable[[int], float],
) -> Array:
    """Sums of sines (T, J) near the wanted frequencies, at most 1; no two joints share one.

    `height`: of a sine with so many cycles. They rise and fall within half a second at the ends.
    """
    inside = np.clip(t_s - LEAD_S, 0, length_s)
    moved = np.zeros((len(t_s), joints))
    for j in range(joints):
        for block in sorted({int(f * length_s) // joints for f in wanted_hz}):
            cycles, phase = joints * block + j + 1, rng.uniform(0, 2 * np.pi)
            moved[:, j] += height(cycles) * np.sin(2 * np.pi * cycles * inside / length_s + phase)
    edge = np.minimum(inside, length_s - inside) / 0.5
    moved *= np.sin(np.pi / 2 * np.clip(edge, 0, 1))[:, None] ** 2
    return moved / np.abs(moved).max(axis=0)


def _press(since_s: Array) -> Array:
    """A trapezoid of height 1: ramp up, press, ramp down."""
    return np.clip(np.minimum(since_s, 2 * RAMP_S + PRESS_S - since_s) / RAMP_S, 0, 1)


def _stairs(t_s: Array, knots_s: Array, levels: Array) -> Array:
    """Levels one after the other, with a ramp at each change."""
    at = np.stack([knots_s, knots_s + RAMP_S], axis=1).ravel()
    return np.interp(t_s, at, np.stack([np.append(0.0, levels[:-1]), levels], axis=1).ravel())
