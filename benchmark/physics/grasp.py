"""The three-finger grasp in one engine: force balance, and friction by Coulomb's law."""

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np

from backends import kinematics
from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, InitialState, State
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.rigs import G_M_S2, STICK
from tasks.initial_states import sample_initial_states

SLIPPERY, HELD_SHARE, HELD_FRICTION = 0.1, 0.4, 0.8
CREEP_M_S, FALL_M_S = 2e-3, 0.1


def grasp(specs: Sequence[Spec]) -> InitialState:
    """The nominal grasp: fingers touch, the stick is upright."""
    return sample_initial_states(specs, np.random.default_rng(0), 0.0)


def squeeze(engine: type[Engine], specs: Sequence[Spec], time_s: float) -> State:
    """The states while the grasp's preload acts."""
    start = grasp(specs)
    preload = np.array([spec.hand.preload_rad for spec in specs])
    periods = round(time_s / specs[0].timing.policy_s)
    return rollout.record(engine, specs, start, np.tile(start.joint_rad + preload, (periods, 1, 1)))


def balance(engine: type[Engine]) -> Iterator[Check]:
    """Press for 1 s and compare reported forces with those that follow from the torques."""
    spec = rigs.frictionless(rigs.hand())
    state = squeeze(engine, [spec], 1.0)
    forces = tip_forces(spec, state)
    normals = -state.contact_force_n[-1, 0]
    sizes = np.linalg.norm(normals, axis=1)
    inward = normals[:, :2] / sizes[:, None]
    along = (forces * inward).sum(axis=1)
    across = forces[:, 0] * inward[:, 1] - forces[:, 1] * inward[:, 0]
    yield Check(
        name="grasp, sum of the tips' forces from the motors' torques",
        figure=float(np.abs(forces.sum(axis=0)).max()),
        unit="N",
        expected=0.0,
        bound=1e-3,
        why=f"force balance of a stick at rest under {sizes.sum():.1f} N; some motion after 1 s",
    )
    yield Check(
        name="grasp, reported normal forces over those from the torques",
        figure=float((sizes / along)[np.argmax(np.abs(sizes / along - 1))]),
        unit="1",
        expected=1.0,
        bound=2e-3,
        why="lever rule at the reported points, which are up to 0.1 mm deep in soft contacts",
    )
    yield Check(
        name="grasp, largest friction over normal force",
        figure=float((np.abs(across) / sizes).max()),
        unit="1",
        expected=0.0,
        bound=spec.stick.friction,
        why="inside Coulomb's cone",
    )


def tip_forces(spec: Spec, path: State) -> Array:
    """Horizontal forces (F, 2) [N] of the tips on the stick that balance both joints of a finger.

    At rest a joint's torque is its axis . (arm x force); two vertical hinges give two equations.
    """
    frames = kinematics.body_frames(spec.hand, path.joint_rad[-1])
    bodies = {body.name: body for body in spec.hand.bodies}
    forces = []
    for point, tip in zip(path.contact_point_m[-1, 0], spec.hand.fingertips, strict=True):
        distal = bodies[tip.body]
        hinges = (bodies[str(distal.parent)], distal)
        arms = [np.cross(b.joint.axis, point - frames[b.name][0][0])[:2] for b in hinges]
        columns = [spec.hand.joint_names.index(b.joint.name) for b in hinges]
        forces.append(np.linalg.solve(arms, path.drive_torque_nm[-1, 0, columns]))
    return np.array(forces)


def slip(engine: type[Engine]) -> Iterator[Check]:
    """Hold sticks of growing mass in the hand as built; the worlds differ only in that mass."""
    slippery = dataclasses.replace(STICK, friction=SLIPPERY)
    built = dataclasses.replace(rigs.hand("built"), stick=slippery)
    grip_n = SLIPPERY * _squeeze_n(engine, built)
    shares = np.array([0.85, 0.95, 1.05, 1.15])
    specs = [_heavy(built, float(share * grip_n / G_M_S2)) for share in shares]
    speed = -squeeze(engine, specs, 0.5).stick_vel_m_s[-1, :, 2]
    held, slips = shares[speed < CREEP_M_S], shares[speed > FALL_M_S]
    bracketed = 0 < len(held) < len(shares) == len(held) + len(slips)
    yield Check(
        name="slip of the three-finger grasp, weight over mu times squeeze",
        figure=float(held.max() + slips.min()) / 2 if bracketed else math.nan,
        unit="1",
        expected=1.0,
        bound=0.05,
        why="Coulomb's law; after 0.5 s a stick creeps at under 2 mm/s or falls at over 100 mm/s; "
        "the squeeze changes slightly under a heavy stick",
    )


def carry(engine: type[Engine]) -> Iterator[Check]:
    """Carry a stick that weighs 0.4 times the squeeze at friction 0.8; drop it at 0.1."""
    probe = rigs.frictionless(rigs.hand())
    mass_kg = HELD_SHARE * _squeeze_n(engine, probe) / G_M_S2
    specs = [
        dataclasses.replace(
            probe, stick=dataclasses.replace(STICK, mass_kg=mass_kg, friction=friction)
        )
        for friction in (HELD_FRICTION, HELD_FRICTION / 8)
    ]
    path = squeeze(engine, specs, 0.4)
    sunk = grasp(specs).stick_pos_m[:, 2] - path.stick_pos_m[-1, :, 2]
    free_s = 0.4 - probe.timing.weightless_s
    braked_m_s2 = G_M_S2 * (1 - HELD_FRICTION / 8 / HELD_SHARE)
    yield Check(
        name="grasp, heavy stick sunk in 0.4 s",
        figure=1e3 * float(sunk[0]),
        unit="mm",
        expected=0.0,
        bound=1.0,
        why=f"{mass_kg:.2f} kg is half of what friction holds; contacts yield before they hold",
    )
    yield Check(
        name="grasp, fall of a heavy stick that friction only brakes",
        figure=float(sunk[1]),
        unit="m",
        expected=braked_m_s2 * free_s**2 / 2,
        bound=0.15 * braked_m_s2 * free_s**2 / 2,
        why="(g - mu N / m) t^2 / 2; the squeeze N changes as the stick slides past the tips",
    )


def steady(engine: type[Engine]) -> Iterator[Check]:
    """Hold the stick for 2 s in the hand as built; the first 0.2 s do not count."""
    path = squeeze(engine, [rigs.hand("built")], 2.0).stick_pos_m[:, 0]
    yield Check(
        name="held stick, moved in 1.8 s",
        figure=1e3 * float(np.linalg.norm(path[10:] - path[9], axis=1).max()),
        unit="mm",
        expected=0.0,
        bound=1.0,
        why="friction holds over twenty times the weight; contacts may creep by 0.5 mm/s",
    )


def _squeeze_n(engine: type[Engine], spec: Spec) -> float:
    """Sum of the normal forces after 0.5 s [N]."""
    forces = squeeze(engine, [spec], 0.5).contact_force_n[-1, 0]
    return float(np.linalg.norm(forces, axis=1).sum())


def _heavy(spec: Spec, mass_kg: float) -> Spec:
    return dataclasses.replace(spec, stick=dataclasses.replace(spec.stick, mass_kg=mass_kg))
