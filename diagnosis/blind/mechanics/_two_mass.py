"""Digital servos on a geared limb; a plant adds its laws of servo and friction.

    J w' = i (1 - fade heat) + ripple sin(n motor) + cogging sin(18 motor) - gear - viscous w - F
    M(q) q'' + h(q, q') = gear + push + stop                      a plane chain, see `_chain`
    gear = (k twist + c twist') (1 + (k twist / T)^2 / s), beyond the play; teeth only push

Heat, cogging and stops are laws of `_faults`.
A servo samples: it reads its encoder once a period, what it asks for acts one period later, and the
current i follows it within a time constant. Dry friction F acts on the rotor, or between the links
where a gear's losses lie behind its spring. It is `level` times a law of the make, with

    level = coulomb + one-way + stiction law(w) + load |gear| + worm where load drives

Semi-implicit Euler at 0.05 ms. A make passes its laws as compiled functions:

    servo(target, motor, speed, first, numbers, own, state) -> torque asked for [Nm]
    friction(speed, stribeck, own, state) -> share of the level, -1 to 1
"""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind.mechanics import _faults
from diagnosis.blind.mechanics._chain import geometry, move
from diagnosis.blind.plant import DRIVE, Course, Limb

TICK_S = 5e-5
STRIBECK_RAD_S = 0.05
"""Speed at which stiction has faded to a third."""
STATES = 12
"""Length of the state per joint of a plant's laws: servo from 0 on, friction from 6 on."""


@dataclass(frozen=True, kw_only=True)
class Chassis:
    """The numbers that this file needs of a plant; scalars or one number per joint."""

    period_s: float | Array = 1e-3
    """Period of the servo [s]."""
    current_s: float | Array = 0.0
    """Time constant of the current [s]."""
    ripple_nm: float | Array = 0.0
    ripple_per_rad: float | Array = 1.0
    """Amplitude and angular frequency of the motor's own cogging."""
    stiffness_nm_rad: float | Array = np.inf
    """The gear's own stiffness, in series with the limb's nominal one."""
    stiffens_nm: float | Array = np.inf
    """Torque at which the gear is twice as stiff as at rest."""
    hysteresis_nm: float | Array = 0.0
    """Friction inside of the gear's spring, which lags its twist."""
    behind: bool = False
    """Dry friction acts between the links, behind the gear."""


_ROW = numba.float64[::1]
SERVO = numba.float64(*[numba.float64] * 3, numba.boolean, _ROW, _ROW, _ROW)
FRICTION = numba.float64(numba.float64, _ROW, _ROW)
"""Signatures of a plant's laws: the loop that calls them is compiled once, for all makes."""
_TABLE = numba.float64[:, ::1]
_LAWS = [numba.types.FunctionType(law) for law in (SERVO, FRICTION)]
_RUN = numba.types.UniTuple(_TABLE, 3)(*_LAWS, *[_TABLE] * 6, _ROW)
HYSTERESIS_RAD = 3e-4
"""Twist over which friction inside of a gear builds up."""


def run(
    laws: tuple[Callable, Callable],
    chassis: Chassis,
    own: Array,
    limb: Limb,
    wanted_rad: Array,
    push_nm: Array,
) -> Course:
    """The motion of a limb; `own` are the numbers of a plant's laws, shape (K, joints)."""
    links, pull = geometry(limb)
    shape, numbers = push_nm.shape[1], dict(limb.numbers)
    nominal = np.array([b.joint.drive.gear_stiffness_nm_rad for b in limb.bodies if b.joint.drive])
    compliance = 1 / numbers["stiffness"] - 1 / nominal  # what an effect adds to the make's own
    numbers["stiffness"] = 1 / (compliance + 1 / np.minimum(chassis.stiffness_nm_rad, nominal))
    drives = np.array([numbers[name] for name in DRIVE])
    period = np.round(np.broadcast_to(chassis.period_s, shape) / TICK_S)
    lag = np.broadcast_to(chassis.current_s, shape)
    keeps = np.where(lag > 0, np.exp(-TICK_S / np.maximum(lag, 1e-12)), 0.0)
    frame = [period, keeps, chassis.ripple_nm, chassis.ripple_per_rad]
    frame += [chassis.stiffens_nm, chassis.hysteresis_nm, float(chassis.behind)]
    return _run(
        *laws,
        np.ascontiguousarray(wanted_rad),
        np.ascontiguousarray(push_nm),
        drives.T.copy(),
        np.stack([np.broadcast_to(row, shape) for row in frame], axis=1).astype(float),
        np.ascontiguousarray(own.T),
        links,
        pull,
    )


@numba.njit(cache=True)
def quantised(x, step):
    """The nearest multiple of a step; x itself where that is 0."""
    return np.floor(x / step + 0.5) * step if step > 0 else x


@numba.njit(cache=True)
def banded(error, dead):
    """An error of which a dead zone takes its share."""
    return error - min(max(error, -dead), dead)


@numba.njit(cache=True)
def read_speed(motor, period_s, keeps, first, state):
    """Speed as measured by a servo: the encoder's difference over a period, filtered.

    Keeps the last reading in state[0] and the filtered speed in state[1].
    """
    raw = 0.0 if first else (motor - state[0]) / period_s
    state[0] = motor
    state[1] = raw + keeps * (state[1] - raw)
    return state[1]


@numba.njit(cache=True)
def bristle(speed, bend_rad, bend):
    """Relative deflection of a bristle that yields by `bend_rad` before it slides.

    z' = (w - |w| z) / d: Dahl, Aerospace report TOR-0158, 1968; implicit in z. At constant speed z
    is the sign of the speed.
    """
    slid = TICK_S * speed / bend_rad
    return (bend + slid) / (1 + abs(slid))


@numba.njit(cache=True)
def _gear(twist, rate, drive, frame, hysteresis):
    """Torque of the teeth; they only push. The lag of their own friction, -1 to 1, beside it."""
    stiff, damping, play = drive[6], drive[7], drive[8]
    depth = banded(twist, play)
    spring = stiff * depth
    torque = spring * (1 + (spring / frame[4]) ** 2)
    if depth != 0.0 or play == 0.0:
        torque += damping * rate
    if play > 0.0 and torque * depth <= 0.0:
        torque = 0.0
    lagged = bristle(rate, HYSTERESIS_RAD, hysteresis)
    return torque + frame[5] * lagged, lagged


@numba.njit(cache=True)
def _level(speed, pushed, gear, drive):
    """Largest dry friction [Nm] beside that which fades with speed."""
    level = drive[4] + drive[11] * abs(gear) + _faults.one_way(drive[13], speed)
    if speed * gear <= 0.0 and pushed * gear >= 0.0 and abs(gear) > abs(pushed):
        level += drive[9]  # the load drives the motor, and the worm holds
    return level


@numba.njit(_RUN, cache=True)
def _run(servo, friction, wanted, push, drives, frames, own, links, pull):
    """Angles at every tick, motor angles and torques at every sample, of one limb."""
    samples, joints = push.shape
    steps = (len(wanted) - 1) // (samples - 1)
    q, qd, motor, speed = wanted[0].copy(), np.zeros(joints), wanted[0].copy(), np.zeros(joints)
    state, asked, ready = np.zeros((joints, STATES)), np.zeros(joints), np.zeros(joints)
    current, heat, hysteresis = np.zeros(joints), np.zeros(joints), np.zeros(joints)
    torque, acceleration = np.zeros(joints), np.zeros(joints)
    angle = np.zeros(wanted.shape)
    motor_out, torque_out = np.zeros((samples, joints)), np.zeros((samples, joints))
    for tick in range(len(wanted)):
        angle[tick] = q
        if tick % steps == 0:
            motor_out[tick // steps], torque_out[tick // steps] = motor, current
        if tick + 1 == len(wanted):
            break
        for j in range(joints):
            drive, frame, x, w = drives[j], frames[j], motor[j], speed[j]
            if tick % int(frame[0]) == 0:
                ready[j] = asked[j]
                asked[j] = servo(wanted[tick, j], x, w, tick == 0, drive, own[j], state[j])
            current[j] = ready[j] + frame[1] * (current[j] - ready[j])
            current[j] = _faults.reached(current[j], w, drive[2], drive[14])
            heat[j] = _faults.warmed(heat[j], current[j] / drive[2], TICK_S)
            pushed = current[j] * _faults.faded(drive[19], heat[j])
            pushed += frame[2] * np.sin(frame[3] * x) + _faults.cogged(drive[15], x)
            gear, hysteresis[j] = _gear(x - q[j], w - qd[j], drive, frame, hysteresis[j])
            rubs = qd[j] if frame[6] > 0 else w
            level = _level(rubs, pushed, gear, drive)
            fades = np.exp(-abs(rubs) / STRIBECK_RAD_S)
            dry = (level + drive[10] * fades) * friction(rubs, own[j], state[j])
            rotor = drive[3]
            moved = w + TICK_S / rotor * (pushed - gear - (0.0 if frame[6] > 0 else dry))
            speed[j] = moved / (1 + TICK_S / rotor * drive[5])
            motor[j] += TICK_S * speed[j]
            torque[j] = gear + push[tick // steps, j] - (dry if frame[6] > 0 else 0.0)
            stop, lower, upper = drive[16:19]
            torque[j] += _faults.stopped(q[j], qd[j], stop, lower, upper, drive[0], drive[1])
        move(q, qd, torque, links, pull, acceleration, TICK_S)
    return angle, motor_out, torque_out
