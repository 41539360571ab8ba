"""What a drive period does to a replay, and when a sample is taken: nominal, and uncertain.

These change no catalogue: a fit moves them as it moves gains and masses.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.spec import Drive, Joint, Spec
from backends.state import Array
from diagnosis.replay.replay import link_inertias_kgm2


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
        sum(e.magnitude for e in effects if isinstance(e, kind))
        for kind in (Late, AngleLate, TorqueLate)
    )
    return np.array([every + angle, every + angle, every + torque])


def rates(shown: Array, time_s: Array, spec: Spec) -> Array:
    """Rates of position, motor angle and torque, shape (3, T, J), of what a replay shows (4, T, J).

    Samples are too far apart for differences of an angle: a joint's is its velocity, as old as its
    sensor's readings, and differences say how much faster the motor turns.
    """
    position, motor, torque, velocity = shown
    read = np.stack(
        [
            _read(body.joint, time_s, v)
            for body, v in zip(spec.hand.driven, velocity.T, strict=True)
        ],
        axis=1,
    )
    at_motor = np.array([body.joint.sensor == "motor" for body in spec.hand.driven])
    angle = np.where(at_motor, _slope(position, time_s), read)
    return np.stack([angle, angle + _slope(motor - position, time_s), _slope(torque, time_s)])


def _read(joint: Joint, time_s: Array, velocity_rad_s: Array) -> Array:
    """How fast the readings (T,) of a joint's sensor change."""
    age_s, scale = joint.encoder.delay_s, 1 + joint.encoder.scale_error
    return scale * (np.interp(time_s - age_s, time_s, velocity_rad_s) if age_s else velocity_rad_s)


def _slope(values: Array, time_s: Array) -> Array:
    """Central differences of (T, J), zero at the ends."""
    slope = np.zeros_like(values)
    slope[1:-1] = (values[2:] - values[:-2]) / (time_s[2:] - time_s[:-2])[:, None]
    return slope
