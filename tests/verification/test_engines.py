"""Every engine against closed forms: free fall, static loads, the statics of a grasp, friction."""

import dataclasses

import numpy as np
import pytest

from backends import kinematics, sticks, trx
from backends.engine import Engine
from backends.spec import Spec, Stick
from backends.state import Array, InitialState, State
from benchmark import registry
from benchmark.errors import CommandError
from tasks.initial_states import sample_initial_states

FLOAT32 = 6e-8
"""Relative rounding of the coarsest engine."""


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))


def frictionless(stick: Stick = sticks.STICKS["reference"]) -> Spec:
    """The ideal hand without Coulomb friction: at rest its motors carry the load alone."""
    spec = trx.spec(stick)
    return spec.with_drives(tuple(dataclasses.replace(d, coulomb_nm=0.0) for d in spec.drives))


def grasp(specs: list[Spec]) -> InitialState:
    """The nominal grasp, fingers touching, the stick upright."""
    return sample_initial_states(specs, np.random.default_rng(0), 0.0)


def squeeze(specs: list[Spec]) -> Array:
    """Targets that press the nominal grasp, shape (N, J)."""
    return grasp(specs).joint_rad + np.array([s.hand.preload_rad for s in specs])


def aside(specs: list[Spec]) -> InitialState:
    """The nominal grasp with the stick where no finger is."""
    start = grasp(specs)
    return dataclasses.replace(start, stick_pos_m=start.stick_pos_m + np.array([5.0, 0.0, 0.0]))


def settle(
    engine: type[Engine], specs: list[Spec], start: InitialState, target: Array, periods: int
) -> State:
    """The state of fresh worlds after holding the targets."""
    worlds = engine(specs)
    state = worlds.reset(start, np.ones(len(specs), dtype=bool))
    for _ in range(periods):
        state = worlds.advance(target)
    worlds.close()
    return state


def test_stick_hangs_then_falls(engine: type[Engine]) -> None:
    """Stay still for 0.1 s, then fall g t^2 / 2 within the g t dt / 2 of semi-implicit Euler."""
    spec = frictionless()
    start = aside([spec])
    worlds = engine([spec])
    worlds.reset(start, np.ones(1, dtype=bool))
    rounding_m = FLOAT32 * np.abs(start.stick_pos_m).max()
    for period in range(1, 26):
        state = worlds.advance(squeeze([spec]))
        moved = state.stick_pos_m - start.stick_pos_m
        t = max(0.0, period * spec.timing.policy_s - spec.timing.weightless_s)
        if t == 0.0:
            assert np.abs(moved).max() <= rounding_m
            assert not state.stick_vel_m_s.any()
        euler_m = 9.81 * t * spec.timing.drive_s / 2
        assert moved[0] == pytest.approx([0, 0, -9.81 * t**2 / 2], abs=1.01 * euler_m + 2e-6)
        assert not state.stick_omega_rad_s.any()
    worlds.close()


def gravity_torque(spec: Spec, joint_rad: Array) -> Array:
    """Torques (N, J) [Nm] of gravity on the joints: the sum of axis . (arm x weight) outwards."""
    frames = kinematics.body_frames(spec.hand, joint_rad)
    bodies = {body.name: body for body in spec.hand.bodies}
    torque = np.zeros_like(joint_rad)
    for body in spec.hand.bodies:
        origin, rotation = frames[body.name]
        center = origin + rotation @ np.array(body.com_m)
        weight = body.mass_kg * np.array(spec.gravity_m_s2)
        carrier = body
        while True:
            if carrier.joint.drive is not None:
                base, turned = frames[carrier.name]
                axis = turned @ np.array(carrier.joint.axis)
                moment = np.cross(center - base, weight)
                column = spec.hand.joint_names.index(carrier.joint.name)
                torque[:, column] += (axis * moment).sum(axis=1)
            if carrier.parent is None:
                break
            carrier = bodies[carrier.parent]
    return torque


@pytest.mark.parametrize("gravity_m_s2", [(0.0, 98.1, 0.0), (0.0, -98.1, 0.0), (98.1, 0.0, 0.0)])
def test_tilted_joints_sag_by_load_over_stiffness(
    engine: type[Engine], gravity_m_s2: tuple[float, float, float]
) -> None:
    """Sag by load / kp at the motor and load / k more at the joint, ten times gravity aside."""
    spec = dataclasses.replace(frictionless(), gravity_m_s2=gravity_m_s2)
    target = squeeze([spec])
    state = settle(engine, [spec], aside([spec]), target, 40)
    load = gravity_torque(spec, state.joint_rad)
    kp, k = (
        np.array([getattr(d, name) for d in spec.drives])
        for name in ("kp_nm_rad", "gear_stiffness_nm_rad")
    )
    assert np.abs(load).min() > 0.03
    assert state.motor_rad - target == pytest.approx(load / kp, abs=2e-6)
    # In 32 bits a joint may stop short where its speed's step is lost in its angle.
    assert state.joint_rad - state.motor_rad == pytest.approx(load / k, abs=5e-6)
    assert state.drive_torque_nm == pytest.approx(-load, abs=1e-5)


def tip_forces(spec: Spec, state: State) -> Array:
    """Horizontal forces (F, 2) [N] of the tips on the stick that balance both joints of a finger.

    At rest a joint's torque is its axis . (arm x force); two vertical hinges give two equations.
    """
    frames = kinematics.body_frames(spec.hand, state.joint_rad)
    bodies = {body.name: body for body in spec.hand.bodies}
    forces = []
    for point, tip in zip(state.contact_point_m[0], spec.hand.fingertips, strict=True):
        distal = bodies[tip.body]
        hinges = (bodies[str(distal.parent)], distal)
        arms = [np.cross(b.joint.axis, point - frames[b.name][0][0])[:2] for b in hinges]
        columns = [spec.hand.joint_names.index(b.joint.name) for b in hinges]
        forces.append(np.linalg.solve(arms, state.drive_torque_nm[0, columns]))
    return np.array(forces)


def test_squeeze_is_in_balance(engine: type[Engine]) -> None:
    """Press with what the motors hold: tips' forces sum to zero and agree with those reported."""
    spec = frictionless()
    state = settle(engine, [spec], grasp([spec]), squeeze([spec]), 50)
    forces = tip_forces(spec, state)
    normals = -state.contact_force_n[0]
    sizes = np.linalg.norm(normals, axis=1)
    assert sizes.min() > 1.0
    assert np.abs(forces.sum(axis=0)).max() < 1e-3
    along = (forces * normals[:, :2]).sum(axis=1) / sizes
    assert along == pytest.approx(sizes, rel=2e-3)
    assert (np.abs(normals.sum(axis=0)) < spec.stick.friction * sizes.sum() * 0.02).all()
    across = np.abs(forces[:, 0] * normals[:, 1] - forces[:, 1] * normals[:, 0]) / sizes
    assert (across < spec.stick.friction * sizes).all()


def test_friction_carries_the_stick(engine: type[Engine]) -> None:
    """Hold a weight of half the friction times squeeze; drop it at an eighth of that friction."""
    probe = frictionless()
    pressed = settle(engine, [probe], grasp([probe]), squeeze([probe]), 25)
    squeeze_n = float(np.linalg.norm(pressed.contact_force_n[0], axis=1).sum())
    mass_kg, held_mu = 0.4 * squeeze_n / 9.81, 0.8
    specs = [
        frictionless(dataclasses.replace(probe.stick, mass_kg=mass_kg, friction=mu))
        for mu in (held_mu, held_mu / 8)
    ]
    start = grasp(specs)
    state = settle(engine, specs, start, squeeze(specs), 20)
    sunk = (start.stick_pos_m - state.stick_pos_m)[:, 2]
    free_s = 20 * probe.timing.policy_s - probe.timing.weightless_s
    braked_m_s2 = 9.81 * (1 - held_mu / 8 / 0.4)
    assert abs(sunk[0]) < 1e-3
    assert sunk[1] == pytest.approx(braked_m_s2 * free_s**2 / 2, rel=0.15)
