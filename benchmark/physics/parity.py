"""One engine against the reference: the same targets in free space, in the grasp, open loop.

In free space all engines solve the same equations, so a difference is a bug. In the grasp their
contacts differ. That difference is compared with the change of one engine when its start is shifted
or its time step halved.
"""

import dataclasses
from collections.abc import Iterator
from functools import cache

import numpy as np

from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, quat_z_axis
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.grasp import grasp, squeeze
from benchmark.physics.rigs import DT_S, G_M_S2, STICK

RESPONSE_RAD = 1e-5
MOTIONS, MOTION_S, SWAY_RAD = 4, 4.0, 0.12
SHIFTS_M = {"1 um": 1e-6, "0.1 mm": 1e-4}
LOWER_END_M = -STICK.length_m / 2
PINCHED_M = LOWER_END_M + STICK.grip_to_lower_end_m
"""Positions of two points on the stick's axis, from its centre."""
TOLERANCE_MM = 10.0
"""Distance to the reference path within which a task counts the stick as tracked."""


def response(engine: type[Engine], reference: type[Engine]) -> Iterator[Check]:
    """Follow fast targets without the stick: the ideal hand, and the built one on its teeth."""
    ideal = rigs.hand()
    leaning = rigs.under(rigs.hand("built"), np.array([0.0, 10 * G_M_S2, 0.0]))
    for name, spec in (("ideal hand", ideal), ("hand as built, ten g aside", leaning)):
        t = spec.timing.policy_s * np.arange(1, 101)[:, None]
        hertz = np.linspace(0.5, 1.5, len(spec.hand.joint_names))
        offsets = 0.3 * np.sin(2 * np.pi * t * hertz) + 0.1 * (t > 1.0)
        yield Check(
            name=f"same targets in free space, {name}",
            figure=_parted_rad(_follow(engine, spec, offsets), _follow(reference, spec, offsets)),
            unit="rad",
            expected=0.0,
            bound=RESPONSE_RAD,
            why="same drive law, same semi-implicit Euler; 32-bit joints round at 1e-6 rad"
            + ("" if spec is ideal else "; ten g press the teeth, else play would be chaotic"),
        )
    yield _in_play(engine, reference)


def _in_play(engine: type[Engine], reference: type[Engine]) -> Check:
    """The built hand without gravity on its hinges, where joints drift within their play."""
    spec = rigs.hand("built")
    offsets = np.repeat([[1.0], [-1.5]], 25, axis=0) * [0.1, -0.2, 0.15, 0.1, -0.1, 0.2]
    theirs = _follow(reference, spec, offsets)
    moved = _parted_rad(_follow(reference, spec, offsets, 1e-7), theirs)
    return Check(
        name="same targets in free space, hand as built",
        figure=_parted_rad(_follow(engine, spec, offsets), theirs),
        unit="rad",
        expected=0.0,
        bound=1e-2,
        why="joints drift within their play, which amplifies rounding: in the reference itself, a "
        f"start that is 1e-7 rad off ends {moved:.1g} rad off",
    )


def _follow(engine: type[Engine], spec: Spec, offsets_rad: Array, shift_rad: float = 0.0) -> Array:
    """Joint angles (T, J) of the free hand; targets are the grasp plus offsets (T, J)."""
    rest = np.array(spec.hand.grasp_rad)
    start = rollout.at_rest([spec], rest + shift_rad)
    return rollout.record(engine, [spec], start, (rest + offsets_rad)[:, None]).joint_rad[:, 0]


def _parted_rad(one: Array, other: Array) -> float:
    return float(np.abs(one - other).max())


def hold(engine: type[Engine], reference: type[Engine]) -> Iterator[Check]:
    """Hold the stick for 2 s in the hand as built."""
    ours, theirs = (squeeze(e, [rigs.hand("built")], 2.0) for e in (engine, reference))
    apart = ours.stick_pos_m[-1, 0] - theirs.stick_pos_m[-1, 0]
    forces = [np.linalg.norm(s.contact_force_n[-1, 0], axis=-1) for s in (ours, theirs)]
    yield Check(
        name="held stick, distance from the reference",
        figure=1e3 * float(np.linalg.norm(apart)),
        unit="mm",
        expected=0.0,
        bound=1.0,
        why="compliance of the skin: contacts sink by 0 to 0.2 mm, and creep",
    )
    yield Check(
        name="held stick, squeeze of a tip over that of the reference",
        figure=float((forces[0] / forces[1])[np.argmax(np.abs(forces[0] / forces[1] - 1))]),
        unit="1",
        expected=1.0,
        bound=0.1,
        why="kp times the preload of 70 to 140 mrad; sinking by 0.1 mm takes 2 mrad of it",
    )


def floor(engine: type[Engine]) -> Iterator[Check]:
    """Repeat open-loop motions in one engine from shifted starts and at half the time step."""
    way = sway_m(engine)
    finer = _apart_mm(sway_m(engine, dt_s=DT_S / 2), way, LOWER_END_M)
    yield Check(
        name="open-loop grasp, half the time step",
        figure=finer,
        unit="mm",
        expected=0.0,
        bound=TOLERANCE_MM / 2,
        why="the error of the time step is about twice this and must stay within the tasks' bounds",
    )
    for name, shift in SHIFTS_M.items():
        yield Check(
            name=f"open-loop grasp, start {name} higher",
            figure=_apart_mm(sway_m(engine, shift_m=shift), way, LOWER_END_M),
            unit="mm",
            expected=0.0,
            bound=1.1e3 * shift + 2 * finer,
            why="noise floor: at most the shift and the error of the time step",
        )


def motion(engine: type[Engine], reference: type[Engine]) -> Iterator[Check]:
    """Play the same open-loop motions in both engines and compare the paths of the stick."""
    ours, theirs = sway_m(engine), sway_m(reference)
    finer = [sway_m(e, dt_s=DT_S / 2) for e in (engine, reference)]
    moved = sway_m(engine, shift_m=SHIFTS_M["1 um"])
    exact = engine.support["contact.torsion_radius_m"] == "exact"
    turning = theirs if exact else sway_m(reference, torsion=False)
    for name, point_m in (("lower end", LOWER_END_M), ("pinched point", PINCHED_M)):
        step = 2 * _apart_mm(finer[0], ours, point_m), 2 * _apart_mm(finer[1], theirs, point_m)
        noise, spin = _apart_mm(moved, ours, point_m), _apart_mm(turning, theirs, point_m)
        way = _apart_mm(ours, ours[0], point_m)
        yield Check(
            name=f"open-loop grasp, distance of the {name}",
            figure=_apart_mm(ours, theirs, point_m),
            unit="mm",
            expected=0.0,
            bound=sum(step) + noise + spin,
            why=f"errors of the time step {step[0]:.1f} and {step[1]:.2f}, noise {noise:.1f}, "
            f"inexact spin friction {spin:.1f}; the paths are {way:.0f} long",
        )


def _apart_mm(one: Array, other: Array, point_m: float) -> float:
    """Largest distance of a point of the stick within a motion, mean over the motions."""
    apart = one - other
    return 1e3 * float(
        np.linalg.norm(apart[..., 0, :] + point_m * apart[..., 1, :], axis=-1).max(axis=0).mean()
    )


@cache
def sway_m(
    engine: type[Engine], shift_m: float = 0.0, dt_s: float = DT_S, torsion: bool = True
) -> Array:
    """Centre [m] and axis of the stick (T, MOTIONS, 2, 3) in the ideal hand, open loop."""
    spec = rigs.hand(dt_s=dt_s)
    if not torsion:
        contact = dataclasses.replace(spec.contact, torsion_radius_m=0.0)
        spec = dataclasses.replace(spec, contact=contact)
    specs = [spec] * MOTIONS
    start = grasp(specs)
    start = dataclasses.replace(start, stick_pos_m=start.stick_pos_m + np.array([0, 0, shift_m]))
    rest = start.joint_rad + np.array(spec.hand.preload_rad)
    path = rollout.record(engine, specs, start, rest + sway_rad(spec))
    return np.stack([path.stick_pos_m, quat_z_axis(path.stick_quat_wxyz)], axis=2)


def sway_rad(spec: Spec) -> Array:
    """Smooth offsets of the targets (T, MOTIONS, J) that sway the stick and keep it squeezed.

    Both joints of all fingers sway together, the thumb opposite to the others. The first joints of
    the other two also sway against each other, which tilts the stick. Each wave starts at zero with
    a random frequency.
    """
    t = spec.timing.policy_s * np.arange(1, round(MOTION_S / spec.timing.policy_s) + 1)
    rng = np.random.default_rng(0)
    side = np.array([1.0, 1.0, -1.0])
    offsets = []
    for _ in range(MOTIONS):
        first, second = (_wave(t, rng, SWAY_RAD)[:, None] * side for _ in range(2))
        first = first + _wave(t, rng, SWAY_RAD / 2)[:, None] * np.array([1.0, -1.0, 0.0])
        offsets.append(np.stack([first, second], axis=-1).reshape(len(t), -1))
    return np.stack(offsets, axis=1)


def _wave(time_s: Array, rng: np.random.Generator, size_rad: float) -> Array:
    """A sine of 0.3 to 0.7 Hz from zero, growing over the first second."""
    hertz, phase = rng.uniform(0.3, 0.7), rng.uniform(0, 2 * np.pi)
    size = size_rad * rng.uniform(0.3, 1.0)
    wave = np.sin(2 * np.pi * hertz * time_s + phase) - np.sin(phase)
    return size * wave * np.minimum(time_s, 1.0)
