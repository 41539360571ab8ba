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
    "body.carried",
    "two_masses",
)
"""What the numbers of a joint are, in the order in which the compiled replay takes them.

`two_masses`: 1 where rotor and link are coupled by a gear, 0 where they are one rigid body.
"""
KP, KD = COLUMNS.index("drive.kp_nm_rad"), COLUMNS.index("drive.kd_nms_rad")
LIMIT, ROTOR = COLUMNS.index("drive.torque_limit_nm"), COLUMNS.index("drive.rotor_inertia_kgm2")
COULOMB, VISCOUS = COLUMNS.index("drive.coulomb_nm"), COLUMNS.index("drive.viscous_nms_rad")
COGGING, PERIOD, PHASE = (
    COLUMNS.index(f"drive.cogging_{name}") for name in ("nm", "period_rad", "phase_rad")
)
FALL = COLUMNS.index("drive.limit_fall_nms_rad")
FADE, WARM = COLUMNS.index("drive.thermal_fade"), COLUMNS.index("drive.thermal_s")
SLIDING, BRISTLE = COLUMNS.index("drive.presliding_nm"), COLUMNS.index("drive.presliding_rad")
STOP, FIRM = COLUMNS.index("drive.end_stop_rad"), COLUMNS.index("drive.end_stop_nm_rad")
ONE_WAY = COLUMNS.index("drive.one_way_friction_nm")
STICTION, LOAD = COLUMNS.index("drive.stiction_nm"), COLUMNS.index("drive.load_friction")
PLAY, STIFFNESS = COLUMNS.index("drive.play_rad"), COLUMNS.index("drive.gear_stiffness_nm_rad")
TEETH, LOCK = COLUMNS.index("drive.gear_damping_nms_rad"), COLUMNS.index("drive.lock_nm")
DEAD_ZONE, DELAY = COLUMNS.index("drive.dead_zone_rad"), COLUMNS.index("command.delay_s")
SLOWNESS = COLUMNS.index("command.slowness_s_rad")
STEP = COLUMNS.index("command.resolution_rad")
INTEGRAL, FULL = COLUMNS.index("loop.integral_hz"), COLUMNS.index("loop.integral_limit_nm")
CASCADE = COLUMNS.index("loop.speed_integral_hz")
FILTER, LEAD = COLUMNS.index("loop.filter_s"), COLUMNS.index("loop.lead")
UNLIMITED = COLUMNS.index("loop.unlimited")
PROFILE, LAG = COLUMNS.index("loop.profile_rad_s2"), COLUMNS.index("loop.lag_s")
OPEN = COLUMNS.index("loop.open")
BIAS, SCALE = COLUMNS.index("encoder.bias_rad"), COLUMNS.index("encoder.scale_error")
LATE = COLUMNS.index("encoder.delay_s")
ONCE = COLUMNS.index("encoder.eccentricity_rad")
ACROSS = COLUMNS.index("encoder.eccentricity_sine_rad")
MOVING = (KD, VISCOUS, ROTOR, TEETH, SLOWNESS, DELAY, LATE)
"""Numbers that show only while a joint moves: at rest no sensor tells of them."""
OWN_STEPS = len(COLUMNS)
"""Stands for no number of a joint: how far a log is of its model's own simulator, 0 to 1."""
MASS, PAYLOAD = COLUMNS.index("body.mass_kg"), COLUMNS.index("body.payload")
CARRIED, TWO_MASSES = COLUMNS.index("body.carried"), COLUMNS.index("two_masses")


def table(spec: Spec, rigid: bool) -> Array:
    """The numbers of K joints, shape (K, len(COLUMNS)); `rigid`: without gears."""
    rows = []
    for body in spec.hand.driven:
        homes = {
            "drive": body.joint.drive,
            "command": body.joint.command,
            "encoder": body.joint.encoder,
            "loop": body.joint.loop,
            "body": body,
        }
        names = (column.split(".") for column in COLUMNS[:-1])
        rows.append([float(getattr(homes[part], field)) for part, field in names])
    return np.column_stack([rows, np.full(len(rows), float(not rigid))])


def by_name(numbers: Array) -> dict[str, float]:
    """A joint's numbers in the order of COLUMNS, by name."""
    return dict(zip(COLUMNS, map(float, numbers), strict=True))


def with_numbers(
    spec: Spec, numbers: Mapping[str, Mapping[str, float]], gravity_m_s2: Vec3 | None = None
) -> Spec:
    """A world with other numbers, by joint and name, and with other gravity where some is given."""
    world = spec.with_driven(_changed(b, numbers.get(b.joint.name, {})) for b in spec.hand.driven)
    return replace(world, gravity_m_s2=gravity_m_s2 or spec.gravity_m_s2)


def _changed(body: Body, numbers: Mapping[str, float]) -> Body:
    parts: dict[str, dict[str, Any]] = {"body": {}}
    for name in numbers.keys() & set(COLUMNS[:-1]):
        part, field = name.split(".")
        parts.setdefault(part, {})[field] = numbers[name]
    own = parts.pop("body")
    of_joint = {part: replace(getattr(body.joint, part), **some) for part, some in parts.items()}
    return replace(body, joint=replace(body.joint, **of_joint), **own)
