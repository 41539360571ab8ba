"""What may be wrong: nominal parameters with their uncertainty, and effects with sizes to try.

Sizes come from the mechanism and the log, so a servo and a ball screw are treated alike: torques
from the torque limit, dampings and inertias from the nominal ones, angles from the motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect, NumberEffect
from backends.effects import (
    coulomb_friction,
    gear_damping,
    kd_scale,
    kp_scale,
    link_mass,
    rotor_inertia,
    series_elasticity,
    torque_limit,
    viscous_friction,
)
from backends.spec import Drive, Spec
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Nuisance
from diagnosis.attribution.timing import AngleLate, Late, TorqueLate

NOMINAL: tuple[type[NumberEffect], ...] = (
    kp_scale.Effect,
    kd_scale.Effect,
    torque_limit.Effect,
    coulomb_friction.Effect,
    viscous_friction.Effect,
    rotor_inertia.Effect,
    link_mass.Effect,
    series_elasticity.Effect,
    gear_damping.Effect,
)
"""Effects whose numbers are nominal parameters: known, but only so well."""
RANDOM = ("command-dropout", "encoder-noise", "encoder-resolution")
"""Effects that a replay cannot show; they leave fingerprints of their own."""
SAG = 0.08
"""A torque limit is uncertain by at least this share: drives sag before they saturate."""
RUB = 0.002
"""Friction is known no better than to this share of the torque limit."""
TEETH = 0.1
"""The damping of teeth is uncertain by at least this share: it is many losses taken as one."""
DAMPED = 0.3
"""What a drive period takes from a rotor's inertia (see `Late`) is known to this share."""
LATE = 0.5
"""Standard deviation of the time of all readings, in drive periods."""
EXACT = ("drive.kp_nm_rad", "drive.kd_nms_rad", "drive.rotor_inertia_kgm2")
"""What drives do by the same equation everywhere."""
LEVELS: dict[str, tuple[float, ...]] = {
    "share": (0.02, 0.1, 0.4, 1.5),
    "torque": (0.01, 0.05, 0.25),
    "damping": (0.05, 0.3, 1.5),
    "inertia": (0.2, 0.8, 3.0),
    "angle": (0.003, 0.012, 0.05, 0.2),
    "time": (0.003, 0.01, 0.03),
    "slowness": (0.08, 0.3, 1.0),
}
"""Sizes to try by dimension, over the scale that `scale_of` gives."""
FIRM = 4.0
"""A lock of so many torque limits holds any load."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect on a joint and the magnitudes to start from."""

    name: str
    kind: type[Effect]
    joint: str | None
    levels: tuple[float, ...]


def nuisances(nominal: Spec, share: float) -> list[Nuisance]:
    """The nominal parameters of every joint, each uncertain by `share` of its value.

    And the time of the readings, by half a drive period: so far may integrators be apart.
    """
    moment_s = LATE * nominal.timing.drive_s
    found = [
        Nuisance(kind=kind, joint=None, std=moment_s) for kind in (Late, AngleLate, TorqueLate)
    ]
    drives = dict(zip(nominal.hand.joint_names, nominal.drives, strict=True))
    for kind in NOMINAL:
        values = _driven(nominal, nominal.values(kind.number))
        for joint, value in zip(nominal.hand.joint_names, values, strict=True):
            std = share if kind.dimension == "share" else share * value
            std = _unsure(kind, std, drives[joint], moment_s)
            if std > 0 and value != 0:
                found.append(Nuisance(kind=kind, joint=joint, std=std))
    return found


def _unsure(kind: type[Effect], std: float, drive: Drive, moment_s: float) -> float:
    """A standard deviation, and with it how well any model knows the number."""
    if kind is torque_limit.Effect:
        return max(std, SAG)
    if kind is gear_damping.Effect:
        return max(std, TEETH)
    if kind is coulomb_friction.Effect:
        return float(np.hypot(std, RUB * drive.torque_limit_nm))
    if kind is rotor_inertia.Effect:
        return float(np.hypot(std, DAMPED * moment_s * drive.kd_nms_rad))
    return std


def candidates(catalogue: Mapping[str, type[Effect]], evidence: Evidence) -> list[Candidate]:
    """Every effect of the catalogue that a replay can show, on every joint it may be on."""
    found = []
    for name, kind in catalogue.items():
        if name in RANDOM or not _mechanical(kind):
            continue
        for joint in _places(kind, evidence.nominal):
            levels = _levels(kind, scale_of(kind, evidence, joint))
            if levels:
                found.append(Candidate(name=name, kind=kind, joint=joint, levels=levels))
    return found


def _places(kind: type[Effect], nominal: Spec) -> tuple[str | None, ...]:
    """Joints that an effect may be on, and None for all that it concerns where these are more."""
    if not kind.per_joint:
        return (None,)
    joints = nominal.hand.joint_names
    gear = kind.gear if issubclass(kind, NumberEffect) else None
    concerned = [b for b in nominal.hand.driven if gear is None or b.joint.gear == gear]
    return (*joints, None) if len(concerned) > 1 else joints


def scale_of(kind: type[Effect], evidence: Evidence, joint: str | None) -> float:
    """The natural size of an effect's magnitude on a joint, SI."""
    spec = evidence.nominal
    j = 0 if joint is None else spec.hand.joint_names.index(joint)
    drive = spec.drives[j]
    position = np.concatenate([r.measured[0, :, j] for r in evidence.recordings])
    low, high = np.nanpercentile(position, [2, 98])
    excursion = max(float(high - low), 1e-6)
    if not kind.per_joint:
        return 1.0
    return {
        "torque": drive.torque_limit_nm,
        "damping": drive.kd_nms_rad,
        "inertia": drive.rotor_inertia_kgm2,
        "angle": excursion,
        "slowness": 1.0 / excursion,
    }.get(kind.dimension, 1.0)


def _levels(kind: type[Effect], scale: float) -> tuple[float, ...]:
    locks = issubclass(kind, NumberEffect) and kind.number == "drive.lock_nm"
    more = (FIRM,) if locks else ()
    sizes = [scale * level for level in (*LEVELS[kind.dimension], *more)]
    low, high = kind.bounds
    inside = {min(max(m, low), high) for size in sizes for m in (-size, size)}
    return tuple(sorted(inside - {0.0}))


def is_modelled(effect: Effect) -> bool:
    """Whether an effect's law is a model, and another one in another mechanism.

    Friction, teeth, locks and limits are. A sensor's offset or a delay is what it is.
    """
    numbers = (number for number in effect.spec_fields() if number not in EXACT)
    return any(number.startswith("drive.") for number in numbers)


def is_read(effect: Effect) -> bool:
    """Whether an effect is on the readings of a position sensor."""
    return any(number.startswith("encoder.") for number in effect.spec_fields())


def _mechanical(kind: type[Effect]) -> bool:
    """Whether an effect acts on a mechanism in free air."""
    homes = {field.split(".")[0] for field in kind.spec_fields()}
    return homes <= {"drive", "command", "encoder", "body", "spec"}


def _driven(nominal: Spec, values: tuple) -> list:
    """Values of driven joints alone, where `values` has one per body."""
    bodies = nominal.hand.bodies
    if len(values) != len(bodies):
        return list(values)
    return [v for v, b in zip(values, bodies, strict=True) if b.joint.drive is not None]
