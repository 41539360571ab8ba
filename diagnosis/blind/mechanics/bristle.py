"""A real side whose friction has bristles; no solver may be tuned on it.

    i' = (clip(kp band(target - motor) - kd f) - i) / T,    f' = (w - f) / D
    J w' = side(i) i + cogging - gear - viscous w - F
    F    = level a,   a' = (w - |w| a) / d
    level = coulomb + stiction / (1 + (w / V)^2) + load |gear| + worm
    gear = k(flank) x + c x',   x: how deep a flank is pressed, which only pushes

Bristles of relative bend `a` yield by some d before they slide (Dahl, Aerospace TOR-0158, 1968), so
a drive that stands gives way a little and creeps back. The worm holds where the load exceeds the
motor, by the share that the motor does not help. Semi-implicit Euler at 0.1 ms.

On top of the effects there is always a little play, friction and cogging, one flank that is stiffer
than the other, a motor that is stronger to one side, and the lag of current and speed filter.
"""

from dataclasses import dataclass

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind import plant
from diagnosis.blind.mechanics import _faults
from diagnosis.blind.mechanics._chain import geometry, move
from diagnosis.blind.plant import DRIVE, Course, Limb

TICK_S = 1e-4
STRIBECK_RAD_S = 0.05
"""V: speed at which stiction has faded to a half."""

SLOW_RAD_S = 2e-3
"""A motor that is slower against the load does not turn against it."""


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The small faults of every joint."""

    play_rad: float = 2e-4
    """Half play."""
    friction_share: float = 2e-3
    """Dry friction over the torque limit."""
    cogging_share: float = 1.5e-3
    """Amplitude of the cogging torque over the torque limit."""
    cogging_per_rad: float = 41.0
    """Its angular frequency."""
    flank: float = 0.05
    """By how much one flank is stiffer than the mean, as a share."""
    side: float = 0.01
    """By how much the motor is stronger to that side, as a share."""
    bristle_rad: float = 1.5e-4
    """d: bristles bend by this before they slide."""
    current_s: float = 1.5e-4
    """T: time constant of the current loop."""
    speed_s: float = 2e-4
    """D: time constant of the filter of the speed that the servo damps."""


class Mechanics(plant.Mechanics):
    """Limbs of one or two parallel hinges."""

    tick_s: float = TICK_S

    def __init__(self, baseline: Baseline | None = None) -> None:
        self._baseline = baseline or Baseline()

    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """Angles at every tick, motor angles and torques at every sample; see the protocol."""
        links, pull = geometry(limb)
        base = self._baseline
        drives = np.array([limb.numbers[name] for name in DRIVE])
        limits = np.array([b.joint.drive.torque_limit_nm for b in limb.bodies if b.joint.drive])
        drives[DRIVE.index("play")] += base.play_rad
        drives[DRIVE.index("coulomb")] += base.friction_share * limits
        return _run(
            np.ascontiguousarray(wanted_rad),
            np.ascontiguousarray(push_nm),
            drives.T.copy(),
            base.cogging_share * limits,
            links,
            pull,
            base.cogging_per_rad,
            base.flank,
            base.side,
            base.bristle_rad,
            np.exp(-TICK_S / base.current_s) if base.current_s else 0.0,
            np.exp(-TICK_S / base.speed_s) if base.speed_s else 0.0,
        )


@numba.njit(cache=True)
def _run(
    wanted,
    push,
    drives,
    cogging,
    links,
    pull,
    per_rad,
    flank,
    side,
    bristle,
    current_keeps,
    speed_keeps,
):
    """Angles at every tick, motor angles and torques at every sample, of one limb."""
    samples, joints = push.shape
    steps = (len(wanted) - 1) // (samples - 1)
    q, qd, motor, speed = wanted[0].copy(), np.zeros(joints), wanted[0].copy(), np.zeros(joints)
    felt, current, bend = np.zeros(joints), np.zeros(joints), np.zeros(joints)
    heat = np.zeros(joints)
    torque, acceleration = np.zeros(joints), np.zeros(joints)
    angle = np.zeros(wanted.shape)
    motor_out, torque_out = np.zeros((samples, joints)), np.zeros((samples, joints))
    angle[0] = q
    for tick in range(len(wanted)):
        if tick % steps == 0:
            motor_out[tick // steps], torque_out[tick // steps] = motor, current
        if tick + 1 == len(wanted):
            break
        for j in range(joints):
            kp, kd, limit, rotor, coulomb, viscous, stiff, damping, play = drives[j, :9]
            lock, stiction, load, dead, uneven, emf, cog = drives[j, 9:16]
            stop, lower, upper, fade = drives[j, 16:]
            error = wanted[tick, j] - motor[j]
            error -= min(max(error, -dead), dead)
            felt[j] = speed[j] + speed_keeps * (felt[j] - speed[j])
            asked = min(max(kp * error - kd * felt[j], -limit), limit)
            current[j] = asked + current_keeps * (current[j] - asked)
            current[j] = _faults.reached(current[j], speed[j], limit, emf)
            heat[j] = _faults.warmed(heat[j], current[j] / limit, TICK_S)
            pushed = current[j] * (1 + np.copysign(side, current[j]))
            pushed *= _faults.faded(fade, heat[j])
            pushed += cogging[j] * np.cos(per_rad * motor[j]) + _faults.cogged(cog, motor[j])
            twist = motor[j] - q[j]
            depth, way = abs(twist) - play, np.copysign(1.0, twist)
            gear = 0.0
            if depth > 0.0:
                gear = stiff * (1 + flank * way) * depth + damping * way * (speed[j] - qd[j])
                gear = way * max(gear, 0.0)
            level = coulomb + stiction / (1 + (speed[j] / STRIBECK_RAD_S) ** 2) + load * abs(gear)
            level += _faults.one_way(uneven, speed[j])
            driven = -np.sign(gear)  # where the load would turn the motor
            if (pushed - gear) * driven > 0.0 and speed[j] * driven > -SLOW_RAD_S:
                level += lock * (1 - min(max(pushed * driven, 0.0) / abs(gear), 1.0))
            slid = TICK_S * speed[j] / bristle
            bend[j] = (bend[j] + slid) / (1 + abs(slid))
            free = speed[j] + TICK_S / rotor * (pushed - gear - level * bend[j])
            speed[j] = free / (1 + TICK_S / rotor * viscous)
            motor[j] += TICK_S * speed[j]
            torque[j] = gear + push[tick // steps, j]
            torque[j] += _faults.stopped(q[j], qd[j], stop, lower, upper, kp, kd)
        move(q, qd, torque, links, pull, acceleration, TICK_S)
        angle[tick + 1] = q
    return angle, motor_out, torque_out
