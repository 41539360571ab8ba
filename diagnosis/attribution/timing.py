"""What a drive period does to a replay, and when a sample is taken: nominal, and uncertain.

These change no catalogue: a fit moves them as it moves gains and masses.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.spec import Drive, Spec
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


def late_s(effects: Sequence[Effect], channels: Sequence[str]) -> Array:
    """How much later each channel is read [s], shape (C,)."""
    every = sum(e.magnitude for e in effects if isinstance(e, Late))
    torque = sum(e.magnitude for e in effects if isinstance(e, TorqueLate))
    return np.array([every + torque * (name == "torque") for name in channels])


def later(shown: Array, time_s: Array, late_s: Array) -> Array:
    """Readings (C, T, J) of each channel a moment (C,) later, to first order."""
    moved = shown.copy()
    slope = (shown[:, 2:] - shown[:, :-2]) / (time_s[2:] - time_s[:-2])[:, None]
    moved[:, 1:-1] -= late_s[:, None, None] * slope
    return moved
