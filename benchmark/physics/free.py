"""Free motion: a stick that hangs and falls, a pendulum, and conservation of energy."""

from collections.abc import Iterator

import numpy as np

from backends import kinematics
from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, State
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check, rounding
from benchmark.physics.closed import mass_and_bias, pendulum_period_s, upward_crossings_s
from benchmark.physics.rigs import DT_S, G_M_S2

HANG_S, FALL_S = 1.0, 0.4
SWING_S, AMPLITUDE_RAD = 3.0, 0.5


def fall(engine: type[Engine]) -> Iterator[Check]:
    """Compensate the stick's weight, which shows its mass, then let it fall."""
    spec = rigs.rig([rigs.arm()], weightless_s=HANG_S)
    hang, steps = round(HANG_S / DT_S), round(FALL_S / DT_S)
    start = rollout.at_rest([spec])
    path = rollout.record(engine, [spec], start, rollout.idle([spec], hang + steps))
    yield Check(
        name="mass of the stick, error",
        figure=float(np.abs(path.stick_vel_m_s[:hang]).max() / (G_M_S2 * HANG_S)),
        unit="1",
        expected=0.0,
        bound=1e-6,
        why="largest speed in 1 s under gravity minus the spec's weight, over g t",
    )
    moved = path.stick_pos_m[hang:, 0] - start.stick_pos_m[0]
    k = np.arange(1, steps + 1)
    euler = -G_M_S2 * DT_S**2 * k * (k + 1) / 2
    yield Check(
        name="free fall, distance from semi-implicit Euler",
        figure=float(np.abs(moved[:, 2] - euler).max()),
        unit="m",
        expected=0.0,
        bound=float(steps * rounding(engine) * np.abs(euler).max()),
        why="g dt^2 k (k + 1) / 2 after k steps; bound: one rounding per step",
    )
    yield Check(
        name="free fall in 0.4 s",
        figure=float(-moved[-1, 2]),
        unit="m",
        expected=G_M_S2 * FALL_S**2 / 2,
        bound=1.01 * G_M_S2 * FALL_S * DT_S / 2,
        why="g t^2 / 2; semi-implicit Euler falls g t dt / 2 further",
    )
    aside = max(np.abs(moved[:, :2]).max(), np.abs(path.stick_omega_rad_s).max())
    yield Check(
        name="free fall, sideways or turning",
        figure=float(aside),
        unit="m, rad/s",
        expected=0.0,
        bound=0.0,
        why="no force acts sideways and no torque acts",
    )


def pendulum(engine: type[Engine]) -> Iterator[Check]:
    """Swing an arm about a horizontal hinge; check its period and energy."""
    mass, length, own = 0.2, 0.1, 1e-4
    body = rigs.arm(axis=(0.0, 1.0, 0.0), mass_kg=mass, com_m=(0, 0, -length), inertia_kgm2=own)
    spec = rigs.rig([body])
    start = rollout.at_rest([spec], AMPLITUDE_RAD)
    path = rollout.record(engine, [spec], start, rollout.idle([spec], round(SWING_S / DT_S)))
    angle = np.concatenate([[AMPLITUDE_RAD], path.joint_rad[:, 0, 0]])
    speed = np.concatenate([[0.0], path.joint_rad_s[:, 0, 0]])
    inertia, moment = own + mass * length**2, mass * G_M_S2 * length
    crossings = upward_crossings_s(angle, DT_S)
    swings = len(crossings) - 1
    period = pendulum_period_s(inertia, moment, AMPLITUDE_RAD)
    square = moment / inertia * DT_S**2
    lost = len(angle) * rounding(engine)
    yield Check(
        name="pendulum, period at 0.5 rad",
        figure=float((crossings[-1] - crossings[0]) / swings),
        unit="s",
        expected=period,
        bound=period * square / 24 + DT_S * lost,
        why="elliptic integral; with semi-implicit Euler it is shorter by (w dt)^2 / 24",
    )
    energy = inertia * speed**2 / 2 + moment * (1 - np.cos(angle))
    shadow = energy - DT_S / 2 * moment * np.sin(angle) * speed
    yield Check(
        name="pendulum, energy gained or lost in 3 s",
        figure=float(np.abs(shadow / shadow[0] - 1).max()),
        unit="1",
        expected=0.0,
        bound=square + lost,
        why="semi-implicit Euler conserves H - dt/2 H_q q' up to (w dt)^2",
    )


def hand_energy(engine: type[Engine]) -> Iterator[Check]:
    """Let the undriven hand swing under sideways gravity; its energy error is of first order."""
    errors = []
    for dt_s in (DT_S, DT_S / 2):
        spec = rigs.under(rigs.loose(rigs.hand(dt_s=dt_s)), np.array([0.0, G_M_S2, 0.0]))
        start = rollout.at_rest([spec], np.array(spec.hand.grasp_rad))
        path = rollout.record(engine, [spec], start, rollout.idle([spec], round(0.3 / dt_s)))
        kinetic, total = energies_j(spec, path)
        errors.append(np.ptp(total) / kinetic.max())
    yield Check(
        name="undriven hand, energy error of dt over dt / 2",
        figure=float(errors[0] / errors[1]),
        unit="1",
        expected=2.0,
        bound=0.1,
        why="first order of dt; damping or a wrong inertia gives an error that does not halve",
    )


def energies_j(spec: Spec, path: State) -> tuple[Array, Array]:
    """Kinetic and total energy of the hand [J], shape (T,), of world 0."""
    joint, speed = path.joint_rad[:, 0], path.joint_rad_s[:, 0]
    mass, _ = mass_and_bias(spec, joint)
    kinetic = np.einsum("tj,tjk,tk->t", speed, mass, speed) / 2
    frames = kinematics.body_frames(spec.hand, joint)
    height = np.zeros(len(joint))
    for body in spec.hand.bodies:
        origin, rotation = frames[body.name]
        center = origin + rotation @ np.array(body.com_m)
        height -= body.mass_kg * center @ np.array(spec.gravity_m_s2)
    return kinetic, kinetic + height
