"""Kinematics, masses and gravity torques of the hand, engine by engine, against one closed form.

An engine reports no link poses, so its fingertips are probed with the stick. It reports no mass
matrix, so single joints are pushed and the speeds after one step are read: from rest, M q' = torque
dt. Engines that agree with the closed form agree with each other.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np

from backends import kinematics, trx
from backends.engine import Engine
from backends.spec import Fingertip, Spec
from backends.state import Array, InitialState, quat_from_z_axis
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check, rounding
from benchmark.physics.closed import free_swing, mass_and_bias
from benchmark.physics.rigs import DT_S, G_M_S2, TOUCHING_M

POSES, SWING_S = 8, 0.3
OVERLAP_M = 2e-5
"""Depth of the probing stick in the skin; some engines give no force for the first 0.01 mm."""


def tips(engine: type[Engine]) -> Iterator[Check]:
    """Touch every fingertip from its side and its front in random poses."""
    offsets = [_probe(engine, tip) for tip in trx.HAND.fingertips]
    yield Check(
        name="fingertips by touch, distance from the kinematics",
        figure=float(np.max(offsets)),
        unit="m",
        expected=0.0,
        bound=1e-6,
        why=f"contact points in {3 * POSES} poses, touched from two sides, across the push",
    )


def _probe(engine: type[Engine], tip: Fingertip) -> Array:
    """Distances (2 POSES,) of contact points from the lines along which the stick was pushed."""
    rng = np.random.default_rng(0)
    bare = rigs.loose(rigs.hand())
    bare = dataclasses.replace(bare, hand=dataclasses.replace(bare.hand, fingertips=(tip,)))
    joint = np.repeat(rng.uniform(-1.0, 1.5, (POSES, len(bare.hand.joint_names))), 2, axis=0)
    origin, rotation = (part[:, 0] for part in kinematics.tip_frames(bare.hand, joint))
    local, back_m = _spots(rng, tip)
    normal = np.einsum("nij,nj->ni", rotation, local)
    middle = origin - back_m[:, None] * rotation[:, :, 0]
    specs = [rigs.under(bare, -G_M_S2 * n) for n in normal]
    start = _touching(rng, joint, middle, normal, rotation[:, :, 0])
    path = rollout.record(engine, specs, start, joint[None], _biases(specs, joint))
    touched = np.linalg.norm(path.contact_force_n[0, :, 0], axis=1, keepdims=True) > 0.0
    seen = np.where(touched, path.contact_point_m[0, :, 0], np.nan)
    return np.linalg.norm(np.cross(seen - middle, normal), axis=1)


def _spots(rng: np.random.Generator, tip: Fingertip) -> tuple[Array, Array]:
    """Outward normals in the tip's frame, and their distance behind the front's centre [m].

    They alternate between the cylinder's inner side and the front hemisphere.
    """
    n = 2 * POSES
    front = np.tile([0.0, 1.0], POSES)
    towards, across = front * rng.uniform(0.5, 1.2, n), rng.uniform(-0.6, 0.6, n)
    inward = np.cos(towards) * np.cos(across)
    normals = np.stack([np.sin(towards) * np.cos(across), inward, np.sin(across)], axis=1)
    return normals, (1 - front) * rng.uniform(0.2, 0.8, n) * tip.length_m


def _touching(
    rng: np.random.Generator, joint_rad: Array, middle_m: Array, normal: Array, forward: Array
) -> InitialState:
    """Sticks across the fingers that touch them along the normals from `middle_m`."""
    axis = np.cross(normal, forward)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    slide = rng.uniform(-0.05, 0.05, (len(axis), 1))
    return InitialState(
        joint_rad=joint_rad,
        stick_pos_m=middle_m + (TOUCHING_M - OVERLAP_M) * normal + slide * axis,
        stick_quat_wxyz=quat_from_z_axis(axis),
    )


def masses(engine: type[Engine]) -> Iterator[Check]:
    """Push every joint of the hand, and of a tree of links on random axes, in random poses."""
    for name, spec in _hands():
        errors, spread = [], []
        for joint in _poses(spec):
            mass = mass_and_bias(spec, joint[None])[0][0]
            measured = np.linalg.inv(_speeds(engine, spec, joint, np.diag(np.diag(mass))).T / DT_S)
            measured = np.diag(np.diag(mass)) @ measured
            errors.append(np.abs(measured - mass).max() / np.abs(mass).max())
            spread.append(np.linalg.cond(mass))
        yield Check(
            name=f"masses and inertias of the {name}, error of the mass matrix",
            figure=float(np.max(errors)),
            unit="of its largest",
            expected=0.0,
            bound=max(1e-6, rounding(engine) * float(np.max(spread))),
            why="one step from rest, M q' = torque dt; bound: 1e-6, in 32 bits rounding times the "
            f"condition number {np.max(spread):.0f} of the mass matrix",
        )


def gravity(engine: type[Engine]) -> Iterator[Check]:
    """Point gravity in random directions and hold the joints with the torques that balance it."""
    rng = np.random.default_rng(1)
    for name, level in _hands():
        joint = np.array(_poses(level))
        specs = [rigs.under(level, G_M_S2 * rng.normal(size=3)) for _ in joint]
        mass = mass_and_bias(level, joint)[0]
        bias = _biases(specs, joint)
        start = rollout.at_rest(specs, joint)
        left = rollout.record(engine, specs, start, joint[None], bias).joint_rad_s[0]
        error = np.einsum("njk,nk->nj", mass, left) / DT_S
        yield Check(
            name=f"gravity torques of the {name}, error",
            figure=float((np.abs(error).max(axis=1) / np.abs(bias).max(axis=1)).max()),
            unit="of the largest",
            expected=0.0,
            bound=1e-6,
            why="the residual torque after one step under the opposite torques",
        )


def swing(engine: type[Engine]) -> Iterator[Check]:
    """Let the random tree swing freely: the coupling of moving links."""
    spec = rigs.tree(np.random.default_rng(0))
    rest, steps = _poses(spec)[0], round(SWING_S / DT_S)
    path = rollout.record(
        engine, [spec], rollout.at_rest([spec], rest), rollout.idle([spec], steps)
    )
    angle, speed = path.joint_rad[:, 0], path.joint_rad_s[:, 0]
    condition = max(np.linalg.cond(m) for m in mass_and_bias(spec, angle)[0])
    yield Check(
        name="free swing of the random tree, distance from the closed form",
        figure=float(np.abs(angle - free_swing(spec, rest, steps)).max()),
        unit="rad",
        expected=0.0,
        bound=float(steps * rounding(engine) * condition * np.abs(speed).max() * SWING_S),
        why=f"Newton-Euler equations, semi-implicit Euler; joints reach "
        f"{np.abs(speed).max():.0f} rad/s; bound: one rounding per step times the condition number",
    )


def _hands() -> tuple[tuple[str, Spec], ...]:
    level = rigs.under(rigs.loose(rigs.hand()), np.zeros(3))
    return ("hand", level), (
        "random tree",
        rigs.under(rigs.tree(np.random.default_rng(0)), np.zeros(3)),
    )


def _poses(spec: Spec) -> Array:
    joints = len(spec.hand.joint_names)
    return np.random.default_rng(2).uniform(-1.2, 1.2, (POSES, joints))


def _biases(specs: list[Spec], joint_rad: Array) -> Array:
    """Torques (N, J) [Nm] that hold each world at its pose."""
    pairs = zip(specs, joint_rad, strict=True)
    return np.concatenate([mass_and_bias(spec, joint[None])[1] for spec, joint in pairs])


def _speeds(engine: type[Engine], spec: Spec, joint_rad: Array, load_nm: Array) -> Array:
    """Joint speeds (N, J) after one step from rest at a pose under loads (N, J)."""
    specs = [spec] * len(load_nm)
    target = np.zeros((1, *load_nm.shape))
    return rollout.record(
        engine, specs, rollout.at_rest(specs, joint_rad), target, load_nm
    ).joint_rad_s[0]
