"""The drive in every engine: step response, sag under load, the paper's push test, self-lock.

The drive law is the same code for all engines. These checks show that an engine's joints behave as
the spec says, without additional forces.
"""

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from backends import trx
from backends.engine import Engine
from backends.spec import Drive, Spec
from backends.state import Array, State
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.closed import mass_and_bias, step_response
from benchmark.physics.rigs import DT_S, G_M_S2

ARM_KGM2 = 5e-3
STEP_RAD, LOAD_NM, STEP_S = 0.05, 0.12, 1.0
PLAYS_DEG = (0.2, 1.0, 3.0)
PUSH_NM, SETTLE_S = 0.2, 1.5
STOP_RAD = 5e-6
"""A joint that settles may stop short by this in 32 bits, where a step is lost in rounding of the
angle."""


def step(engine: type[Engine]) -> Iterator[Check]:
    """Step the target of an arm that carries a load, at two time steps."""
    drive = dataclasses.replace(trx.PROXIMAL_DRIVE, coulomb_nm=0.0)
    answer, error = _stepped(engine, drive, DT_S)
    _, finer = _stepped(engine, drive, DT_S / 2)
    t = DT_S * np.arange(1, len(answer.joint_rad) + 1)
    angle, speed = step_response(drive, ARM_KGM2, STEP_RAD, LOAD_NM, t)
    final = STEP_RAD + LOAD_NM * (1 / drive.kp_nm_rad + 1 / drive.gear_stiffness_nm_rad)
    measured = answer.joint_rad[:, 0, 0]
    yield Check(
        name="step response, error of dt over dt / 2",
        figure=error / finer,
        unit="1",
        expected=2.0,
        bound=0.1,
        why="semi-implicit Euler converges to the matrix exponential in first order of dt",
    )
    yield Check(
        name="step response, rise from 10 to 90 %",
        figure=1e3 * _rise_s(measured, final),
        unit="ms",
        expected=1e3 * _rise_s(angle, final),
        bound=1e3 * DT_S,
        why="matrix exponential of the drive's equations; bound of one step",
    )
    yield Check(
        name="step response, overshoot",
        figure=100 * (measured.max() / final - 1),
        unit="%",
        expected=100 * (angle.max() / final - 1),
        bound=100 * DT_S * np.abs(speed).max() / final,
        why="matrix exponential; bound: the distance of one step at full speed",
    )
    yield Check(
        name="step response, steady error under 0.12 Nm",
        figure=1e3 * float(answer.motor_rad[-1, 0, 0] - STEP_RAD),
        unit="mrad",
        expected=1e3 * LOAD_NM / drive.kp_nm_rad,
        bound=1e3 * (STOP_RAD + float(np.abs(angle[-1] - final))),
        why="load / kp at the motor; bound: the remaining motion, and 32-bit joints stop short",
    )


def _stepped(engine: type[Engine], drive: Drive, dt_s: float) -> tuple[State, float]:
    """The response, and the largest distance [rad] of the joint from the closed form."""
    spec = rigs.rig([rigs.arm(drive, inertia_kgm2=ARM_KGM2)], dt_s=dt_s)
    steps = round(STEP_S / dt_s)
    target = np.full((steps, 1, 1), STEP_RAD)
    path = rollout.record(engine, [spec], rollout.at_rest([spec]), target, LOAD_NM)
    time_s = dt_s * np.arange(1, steps + 1)
    angle, _ = step_response(drive, ARM_KGM2, STEP_RAD, LOAD_NM, time_s)
    return path, float(np.abs(path.joint_rad[:, 0, 0] - angle).max())


def _rise_s(angle_rad: Array, final_rad: float) -> float:
    """Time from 10 to 90 % of the final angle."""
    path = np.concatenate([[0.0], angle_rad])
    return _reached_s(path, 0.9 * final_rad) - _reached_s(path, 0.1 * final_rad)


def _reached_s(path: Array, level: float) -> float:
    """Time at which a path from zero first reaches a level, interpolated between steps."""
    k = int(np.argmax(path >= level))
    return float(k - 1 + (level - path[k - 1]) / (path[k] - path[k - 1])) * DT_S


def sag(engine: type[Engine]) -> Iterator[Check]:
    """Hold the hand under ten times gravity from three sides: joints sag like springs."""
    gravities = 10 * G_M_S2 * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    level = rigs.frictionless(rigs.hand())
    specs = [rigs.under(level, gravity) for gravity in gravities]
    target = np.add(level.hand.grasp_rad, level.hand.preload_rad)
    held = _held(engine, specs, np.tile(target, (3, 1)), 0.0, 0.8)
    load = -np.concatenate(
        [mass_and_bias(s, q[None])[1] for s, q in zip(specs, held.joint_rad[-1], strict=True)]
    )
    kp, k = (np.array(level.values(f"drive.{n}")) for n in ("kp_nm_rad", "gear_stiffness_nm_rad"))
    motor = held.motor_rad[-1] - target - load / kp
    joint = held.joint_rad[-1] - held.motor_rad[-1] - load / k
    torque = held.drive_torque_nm[-1] + load
    for name, error, unit, bound in (
        ("motors, from load / kp", motor, "rad", 2e-6),
        ("joints beyond, from load / k", joint, "rad", STOP_RAD),
        ("motors' torque, from the load", torque, "Nm", 1e-5),
    ):
        yield Check(
            name=f"sag under ten g, {name}",
            figure=float(np.abs(error).max()),
            unit=unit,
            expected=0.0,
            bound=bound,
            why=f"loads of {np.abs(load).min():.2f} to {np.abs(load).max():.2f} Nm; "
            "32-bit joints stop short",
        )


def push_test(engine: type[Engine]) -> Iterator[Check]:
    """Hold the hand as built and push every joint in both directions: the paper's test of play."""
    specs = [rigs.frictionless(rigs.hand(f"backlash={p}deg,self-lock=10Nm")) for p in PLAYS_DEG]
    worms = _worms(specs[0])
    pushes = np.repeat([0.0, PUSH_NM, -PUSH_NM], round(SETTLE_S / specs[0].timing.policy_s))
    target = np.tile(specs[0].hand.grasp_rad, (len(pushes), len(specs), 1))
    path = _from_grasp(engine, specs, target, pushes[:, None, None]).joint_rad[:, :, worms]
    a, b, c = (part[-1] for part in np.split(path, 3))
    teeth = PUSH_NM / np.array(specs[0].values("drive.gear_stiffness_nm_rad"))[worms]
    found = np.degrees(np.stack([b - a - teeth, a - c - teeth]))
    for play_deg, plays in zip(PLAYS_DEG, found.swapaxes(0, 1), strict=True):
        worst = plays.ravel()[np.argmax(np.abs(plays - play_deg))]
        yield Check(
            name=f"play of {play_deg} deg by the push test",
            figure=float(worst),
            unit="deg",
            expected=play_deg,
            bound=math.degrees(2 * STOP_RAD),
            why="q_b - q_a and q_a - q_c minus torque / k (teeth deflection); worst of J0, J3, J6",
        )


def self_lock(engine: type[Engine]) -> Iterator[Check]:
    """Push locked and free worm joints from both sides; then drive the locked ones under load."""
    specs = [rigs.frictionless(rigs.hand(e)) for e in ("self-lock=10Nm", "none")]
    worms = _worms(specs[0])
    rest = np.array(specs[0].hand.grasp_rad)[worms]
    moved = [_pushed(engine, specs, s).motor_rad[-1][:, worms] - rest for s in (1.0, -1.0)]
    locked, free = np.abs(moved).max(axis=(0, 2))
    yield Check(
        name="pushed worm joint, motor moved",
        figure=1e3 * float(locked),
        unit="mrad",
        expected=0.0,
        bound=0.0,
        why="a load under the lock's torque does not turn a worm",
    )
    kp = np.array(specs[0].values("drive.kp_nm_rad"))[worms]
    yield Check(
        name="pushed joint without the lock, motor moved",
        figure=1e3 * float(free),
        unit="mrad",
        expected=1e3 * float((PUSH_NM / kp).max()),
        bound=1e3 * STOP_RAD,
        why="torque / kp",
    )
    yield _driven(engine, specs[0], worms)


def _driven(engine: type[Engine], spec: Spec, worms: Array) -> Check:
    """Worm joints that lift and lower a load by 0.1 rad."""
    rest = np.array(spec.hand.grasp_rad)
    target = rest + np.array([[0.1], [0.1], [-0.1], [-0.1]])
    load = np.array([[1.0], [-1.0], [1.0], [-1.0]]) * PUSH_NM * np.ones(len(rest))
    end = _held(engine, [spec] * 4, target, load, SETTLE_S)
    left = np.abs(end.motor_rad[-1] - target)[:, worms].max()
    return Check(
        name="driven worm joint, distance to a target 100 mrad away, under load",
        figure=1e3 * float(left),
        unit="mrad",
        expected=0.0,
        bound=1e3 * (PUSH_NM / spec.drives[int(worms[0])].kp_nm_rad + STOP_RAD),
        why="the motor lifts and lowers the load to within load / kp",
    )


def _worms(spec: Spec) -> Array:
    """Columns of the worm-geared joints."""
    return np.flatnonzero([body.joint.gear == "worm" for body in spec.hand.driven])


def _pushed(engine: type[Engine], specs: list[Spec], sign: float) -> State:
    """The hand held at its grasp under a push on every joint."""
    target = np.tile(specs[0].hand.grasp_rad, (len(specs), 1))
    return _held(engine, specs, target, sign * PUSH_NM, SETTLE_S)


def _held(
    engine: type[Engine], specs: list[Spec], target: Array, load: Array | float, time_s: float
) -> State:
    """The hand after holding targets (N, J) under loads."""
    periods = round(time_s / specs[0].timing.policy_s)
    return _from_grasp(engine, specs, np.tile(target, (periods, 1, 1)), load)


def _from_grasp(
    engine: type[Engine], specs: list[Spec], target: Array, load: Array | float
) -> State:
    """The hand, started in its grasp, with the stick out of the way."""
    start = rollout.at_rest(specs, np.array(specs[0].hand.grasp_rad))
    return rollout.record(engine, specs, start, target, load)
