"""A joint's numbers in the compiled replay, under the names that the spec gives them."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from backends.spec import Body, Command, Drive, Encoder, Loop, Spec, Vec3
from backends.state import Array

COLUMNS = (
    *(f"drive.{f.name}" for f in fields(Drive)),
    *(f"command.{f.name}" for f in fields(Command)),
    *(f"encoder.{f.name}" for f in fields(Encoder)),
    *(f"loop.{f.name}" for f in fields(Loop)),
    "body.mass_kg",
    "body.payload",
    "body.payload_x_m",
    "body.payload_y_m",
    "body.payload_z_m",
    "body.carried",
    "two_masses",
)
"""What the numbers of a joint are, in the order in which the compiled replay takes them.

`two_masses`: 1 where rotor and link are coupled by a gear, 0 where they are one rigid body.
"""


def _at(part: str, *names: str) -> tuple[int, ...]:
    return tuple(COLUMNS.index(f"{part}.{name}") for name in names)


KP, KD, ROTOR, DEAD_ZONE = _at(
    "drive", "kp_nm_rad", "kd_nms_rad", "rotor_inertia_kgm2", "dead_zone_rad"
)
LIMIT, FALL, FADE, WARM = _at(
    "drive", "torque_limit_nm", "limit_fall_nms_rad", "thermal_fade", "thermal_s"
)
COULOMB, VISCOUS, STICTION, LOAD, ONE_WAY = _at(
    "drive", "coulomb_nm", "viscous_nms_rad", "stiction_nm", "load_friction", "one_way_friction_nm"
)
COGGING, PERIOD, PHASE = _at("drive", "cogging_nm", "cogging_period_rad", "cogging_phase_rad")
SLIDING, BRISTLE = _at("drive", "presliding_nm", "presliding_rad")
STOP, FIRM = _at("drive", "end_stop_rad", "end_stop_nm_rad")
SPRING, REST, ZERO, WEAK = _at("drive", "spring_nm_rad", "spring_rest_rad", "zero_rad", "weakness")
PLAY, STIFFNESS, TEETH, LOCK = _at(
    "drive", "play_rad", "gear_stiffness_nm_rad", "gear_damping_nms_rad", "lock_nm"
)
DELAY, SLOWNESS, STEP = _at("command", "delay_s", "slowness_s_rad", "resolution_rad")
INTEGRAL, FULL, CASCADE = _at("loop", "integral_hz", "integral_limit_nm", "speed_integral_hz")
FILTER, LAG, LEAD, HOLD = _at("loop", "filter_s", "lag_s", "lead", "hold_s")
UNLIMITED, PROFILE, OPEN, SOFT = _at("loop", "unlimited", "profile_rad_s2", "open", "soft_friction")
BIAS, SCALE, LATE = _at("encoder", "bias_rad", "scale_error", "delay_s")
ONCE, ACROSS = _at("encoder", "eccentricity_rad", "eccentricity_sine_rad")
MASS, PAYLOAD, CARRIED = _at("body", "mass_kg", "payload", "carried")
LINK = tuple(n for n, name in enumerate(COLUMNS) if name.startswith("body."))
TWO_MASSES = COLUMNS.index("two_masses")
MOVING = (KD, VISCOUS, ROTOR, TEETH, SLOWNESS, DELAY, LATE)
"""Numbers that show only while a joint moves: at rest no sensor tells of them."""
OWN_STEPS = len(COLUMNS)
"""Stands for no number of a joint: how far a log is of its model's own simulator, 0 to 1."""


def table(spec: Spec, rigid: bool) -> Array:
    """The numbers of K joints, shape (K, len(COLUMNS)); `rigid`: without gears."""
    names = [column.split(".") for column in COLUMNS[:-1]]
    rows = [
        [float(getattr(_part(body, part), field)) for part, field in names]
        for body in spec.hand.driven
    ]
    return np.column_stack([rows, np.full(len(rows), float(not rigid))])


def _part(body: Body, name: str) -> Any:
    """What has numbers of this part of a joint."""
    return body if name == "body" else getattr(body.joint, name)


def with_load(body: Body, load: Array) -> Body:
    """A body with other numbers of its link, (len(LINK),)."""
    names = [COLUMNS[n].split(".")[1] for n in LINK]
    return replace(body, **dict(zip(names, load.tolist(), strict=True)))


def by_name(numbers: Array) -> dict[str, float]:
    """A joint's numbers in the order of COLUMNS, by name."""
    return dict(zip(COLUMNS, map(float, numbers), strict=True))


def with_numbers(
    spec: Spec, numbers: Mapping[str, Mapping[str, float]], gravity_m_s2: Vec3 | None = None
) -> Spec:
    """A world with other numbers, by joint and name, and with other gravity where some is given."""
    driven = []
    for body in spec.hand.driven:
        own = numbers.get(body.joint.name, {})
        for name in own.keys() & set(COLUMNS[:-1]):
            part, field = name.split(".")
            other, joint = replace(_part(body, part), **{field: own[name]}), body.joint
            body = other if part == "body" else replace(body, joint=replace(joint, **{part: other}))
        driven.append(body)
    return replace(spec.with_driven(driven), gravity_m_s2=gravity_m_s2 or spec.gravity_m_s2)
