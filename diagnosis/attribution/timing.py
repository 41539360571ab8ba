"""What a drive period does to a replay, and when a sample is taken: nominal, and uncertain.

These change no catalogue: a fit moves them as it moves gains and masses.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from backends.effect import Effect
from backends.spec import Drive, Spec
from backends.state import Array
from diagnosis.replay.replay import link_inertias_kgm2

_LOST = 1e6
"""What an unstable world shows [rad or Nm]."""


@dataclass(frozen=True, kw_only=True)
class Late(Effect):
    """No effect of the catalogue: how far, `magnitude` [s], a drive's period is from none at all.

    Semi-implicit Euler with the period dt lets commands act dt / 2 early and damping dt / 2 late,
    which takes about kd dt / 2 from the rotor's inertia. Real drives and other integrators do
    neither. All readings `magnitude` = dt / 2 later make up for the one; an inertia J' with
    1 - kd dt / J' = exp(-kd dt / J), so that a period damps as it should, for the other; and for a
    drive at its limit, which damps nothing, a limit that is larger by as much as what it turns.
    """

    dimension, unit = "time", "ms"
    bounds = (-1.0, 1.0)
    per_joint = False

    def on_spec(self, spec: Spec) -> Spec:
        """See `Effect.on_spec`; the readings are shifted by `later`."""
        links = zip(spec.drives, link_inertias_kgm2(spec), strict=True)
        return spec.with_drives(self._on_drive(drive, link) for drive, link in links)

    def _on_drive(self, drive: Drive, link_kgm2: float) -> Drive:
        inertia = drive.rotor_inertia_kgm2
        damped = 2 * self.magnitude * (drive.kd_nms_rad + drive.viscous_nms_rad)
        grown = damped / -np.expm1(-damped / inertia) if damped else inertia
        stronger = (grown + link_kgm2) / (inertia + link_kgm2)
        return dataclasses.replace(
            drive,
            rotor_inertia_kgm2=float(grown),
            torque_limit_nm=float(drive.torque_limit_nm * stronger),
        )


@dataclass(frozen=True, kw_only=True)
class TorqueLate(Effect):
    """No effect of the catalogue: torques are logged `magnitude` [s] later in a drive period."""

    dimension, unit = "time", "ms"
    bounds = (-1.0, 1.0)
    per_joint = False


@dataclass(frozen=True, kw_only=True)
class AngleLate(Effect):
    """No effect of the catalogue: angles are read `magnitude` [s] later in a drive period.

    A link that is moved after its motor is another part of a period early.
    """

    dimension, unit = "time", "ms"
    bounds = (-1.0, 1.0)
    per_joint = False


def late_s(effects: Sequence[Effect]) -> Array:
    """How much later position, motor angle and torque are read [s], shape (3,)."""
    every, angle, torque = (
        sum((e.magnitude for e in effects if isinstance(e, kind)), 0.0)
        for kind in (Late, AngleLate, TorqueLate)
    )
    return np.array([every + angle, every + angle, every + torque])


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """What rates need to know of a world's position sensors, each (J,)."""

    age_s: Array
    """How old readings are [s]."""
    scale: Array
    """How much larger readings are than the angle."""
    at_motor: Array
    """Whether they sit at the motor, bool."""


def sensors(spec: Spec) -> Sensors:
    """The position sensors of a world."""
    joints = [body.joint for body in spec.hand.driven]
    return Sensors(
        age_s=np.array([joint.encoder.delay_s for joint in joints]),
        scale=np.array([1 + joint.encoder.scale_error for joint in joints]),
        at_motor=np.array([joint.sensor == "motor" for joint in joints]),
    )


def residual(
    measured: Array, shown: Array, time_s: Array, at: Sensors, late: Array, every: int
) -> Array:
    """What measurements (3, T, J) of position, motor angle and torque are beyond a replay.

    The replay (4, T, J) is read `late` (3,) [s] later, and every n-th sample is taken.
    """
    by_sample = shown.transpose(1, 0, 2)  # as it was written: one layout, compiled once
    return _residual(measured, by_sample, time_s, late, at.age_s, at.scale, at.at_motor, every)


def rates(shown: Array, time_s: Array, at: Sensors) -> Array:
    """Rates of position, motor angle and torque, shape (3, T, J), of what a replay shows (4, T, J).

    Samples are too far apart for differences of an angle: a joint's is its velocity, as old as its
    sensor's readings, and differences say how much faster the motor turns.
    """
    return _rates(shown.transpose(1, 0, 2), time_s, at.age_s, at.scale, at.at_motor)


@numba.njit(cache=True, error_model="numpy")
def _residual(measured, shown, time_s, late, age_s, scale, at_motor, every):
    left = np.empty(measured[:, ::every].shape)
    rate = np.zeros((len(late), len(time_s), len(age_s)))
    if late.any():
        rate = _rates(shown, time_s, age_s, scale, at_motor)
    for c in range(len(late)):
        for i in range(left.shape[1]):
            k = i * every
            for j in range(len(age_s)):
                told = shown[k, c, j] - late[c] * rate[c, k, j]
                told = told if np.isnan(told) else min(max(told, -_LOST), _LOST)
                left[c, i, j] = measured[c, k, j] - told
    return left


@numba.njit(cache=True, error_model="numpy")
def _rates(shown, time_s, age_s, scale, at_motor):
    out = np.zeros((3, len(time_s), len(age_s)))
    for j in range(len(age_s)):
        position, motor = shown[:, 0, j], shown[:, 1, j]
        torque, speed = shown[:, 2, j], shown[:, 3, j]
        if age_s[j] > 0.0:
            speed = np.interp(time_s - age_s[j], time_s, speed)
        for k in range(len(time_s)):
            out[0, k, j] = 0.0 if at_motor[j] else scale[j] * speed[k]
        for k in range(1, len(time_s) - 1):
            span = time_s[k + 1] - time_s[k - 1]
            moved = position[k + 1] - position[k - 1]
            if at_motor[j]:
                out[0, k, j] = moved / span
            out[1, k, j] = (motor[k + 1] - motor[k - 1] - moved) / span
            out[2, k, j] = (torque[k + 1] - torque[k - 1]) / span
        for k in range(len(time_s)):
            out[1, k, j] += out[0, k, j]
    return out
