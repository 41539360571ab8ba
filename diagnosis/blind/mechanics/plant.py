"""A real side of other equations than every engine's and the solver's; shares no code with them.

    J w' = sat(kp band(target - motor) - kd w) + cogging - gear - viscous w - F tanh(w / W)
    gear = k band(motor - joint) (1 + s band^2) + c (w - joint speed) band'
    F    = coulomb + uneven + stiction exp(-(w / V)^2) + load |gear| + worm

`band` is a dead band with rounded corners, `sat` a limit with rounded corners that may fall with
speed, the worm a friction that rises with the share of the motion that the load drives.
Semi-implicit Euler at 0.1 ms, the rotor's friction implicit.

On top of the ideal mechanism there is always a little play, friction, cogging and stiffening.
"""

from dataclasses import dataclass

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind import plant
from diagnosis.blind.mechanics._chain import geometry, move
from diagnosis.blind.plant import DRIVE, Course, Limb

TICK_S = 1e-4
CREEP_RAD_S = 2e-3
"""W: speed at which friction has grown to three quarters."""
STRIBECK_RAD_S = 0.05
"""V: speed at which stiction has faded to a third."""
TEETH = 18.0
"""Periods of an effect's cogging per 2 pi rad."""
HEAT_S = 3.0
"""Time constant of a motor's heat [s]."""
STOP_STIFFNESS = 30.0
"""Stiffness of an end stop over the servo's kp."""
CORNER = 0.05
"""Width of a dead zone's corners, as a share of it."""


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The small faults of every joint."""

    play_rad: float = 3e-4
    """Half play."""
    corner_rad: float = 1e-4
    """Width of the play's corners."""
    friction_share: float = 1.5e-3
    """Dry friction over the torque limit."""
    cogging_share: float = 1.5e-3
    """Amplitude of the cogging torque over the torque limit."""
    cogging_per_rad: float = 57.0
    """Its angular frequency: nine slots through a gear of some 40."""
    stiffening_rad2: float = 10.0
    """Relative growth of the teeth's stiffness per squared deflection [1/rad^2]."""


class Mechanics(plant.Mechanics):
    """Smooth equations of a limb whose hinges are parallel, one or two of them."""

    tick_s: float = TICK_S

    def __init__(self, baseline: Baseline | None = None) -> None:
        self._baseline = baseline or Baseline()

    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """Angles at every tick, motor angles and torques at every sample; see `Mechanics`.

        ValueError for what is no plane chain of one or two.
        """
        links, pull = geometry(limb)
        base, numbers = self._baseline, limb.numbers
        drives = np.array([numbers[name] for name in DRIVE])
        drives[DRIVE.index("play")] += base.play_rad
        limits = [b.joint.drive.torque_limit_nm for b in limb.bodies if b.joint.drive]
        shares = np.outer([base.cogging_share, base.friction_share], limits)
        return _run(
            np.ascontiguousarray(wanted_rad),
            np.ascontiguousarray(push_nm),
            np.concatenate([drives, shares]).T.copy(),
            links,
            pull,
            base.corner_rad,
            base.cogging_per_rad,
            base.stiffening_rad2,
        )


@numba.njit(cache=True)
def _softplus(x):
    return max(x, 0.0) + np.log1p(np.exp(-abs(x)))


@numba.njit(cache=True)
def _band(x, half, corner):
    """A dead band of half width `half`; exactly x where that is zero."""
    return corner * (_softplus((x - half) / corner) - _softplus((-x - half) / corner))


@numba.njit(cache=True)
def _slope(x, half, corner):
    """Derivative of `_band`."""
    return 0.5 * (2 + np.tanh((x - half) / corner / 2) + np.tanh((-x - half) / corner / 2))


@numba.njit(cache=True)
def _slowed(speed, decay, friction):
    """The speed w of decay w + friction tanh(w / W) = speed: Newton, which climbs from below."""
    size = abs(speed)
    w = max(0.0, (size - friction) / decay)
    for _ in range(50):
        t = np.tanh(w / CREEP_RAD_S)
        step = (size - decay * w - friction * t) / (decay + friction * (1 - t * t) / CREEP_RAD_S)
        w += step
        if step <= 1e-12 * (w + 1e-9):
            break
    return np.copysign(w, speed)


@numba.njit(cache=True)
def _run(wanted, push, drives, links, pull, corner, per_rad, stiffening):
    """Angles at every tick, motor angles and torques at every sample, of one limb."""
    samples, joints = push.shape
    steps = (len(wanted) - 1) // (samples - 1)
    q, qd, motor, speed = wanted[0].copy(), np.zeros(joints), wanted[0].copy(), np.zeros(joints)
    torque, acceleration = np.zeros(joints), np.zeros(joints)
    angle = np.zeros(wanted.shape)
    motor_out, torque_out = np.zeros((samples, joints)), np.zeros((samples, joints))
    pd, heat = np.zeros(joints), np.zeros(joints)
    angle[0] = q
    for k in range(samples):
        motor_out[k], torque_out[k] = motor, pd
        if k + 1 == samples:
            break
        for i in range(steps):
            for j in range(joints):
                kp, kd, limit, rotor, coulomb, viscous, stiff, damping, play = drives[j, :9]
                lock, stiction, load, dead, uneven, emf, cog = drives[j, 9:16]
                stop, lower, upper, fade, cogging, friction = drives[j, 16:]
                error = wanted[k * steps + i, j] - motor[j]
                if dead > 0.0:
                    error = _band(error, dead, CORNER * dead)
                asked = kp * error - kd * speed[j]
                most = max(limit - emf * abs(speed[j]) * (asked * speed[j] > 0.0), 1e-3 * limit)
                pd[j] = asked / (1 + (asked / most) ** 8) ** 0.125
                heat[j] += TICK_S / HEAT_S * ((pd[j] / limit) ** 2 - heat[j])
                pd[j] /= 1.0 + fade * heat[j]
                bend = motor[j] - q[j]
                pressed = _band(bend, play, corner)
                gear = stiff * pressed * (1 + stiffening * pressed * pressed)
                gear += damping * (speed[j] - qd[j]) * _slope(bend, play, corner)
                free = speed[j] + TICK_S / rotor * (
                    pd[j]
                    - gear
                    - cogging * np.sin(per_rad * motor[j])
                    + cog * np.sin(TEETH * motor[j])
                )
                way = np.sign(free)
                driven, driving = max(0.0, -gear * way), max(0.0, pd[j] * way)
                worm = lock * driven / (driven + driving + 1e-3 * limit)
                dry = coulomb + friction + stiction * np.exp(-((speed[j] / STRIBECK_RAD_S) ** 2))
                dry += load * abs(gear) + worm + max(uneven * way, 0.0)
                decay = 1 + TICK_S / rotor * viscous
                speed[j] = _slowed(free, decay, TICK_S / rotor * dry)
                motor[j] += TICK_S * speed[j]
                torque[j] = gear + push[k, j]
                if stop != 0.0:
                    side = np.sign(stop)
                    deep = side * (q[j] + stop - (upper if stop > 0.0 else lower))
                    torque[j] -= side * STOP_STIFFNESS * kp * corner * _softplus(deep / corner)
            move(q, qd, torque, links, pull, acceleration, TICK_S)
            angle[k * steps + i + 1] = q
    return angle, motor_out, torque_out
