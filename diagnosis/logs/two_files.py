"""A robot's model and its recording, files as they are, put together as a log.

What names and numbers show is taken and said; what they do not is asked for in one sentence.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._columns import KINDS
from diagnosis.logs._files import read_model
from diagnosis.logs._meta import DriveSettings, LogError, LogMeta, MjcfMechanism
from diagnosis.logs.log import Log, make_log, name_of
from diagnosis.logs.roles import (
    ANGLES,
    LENGTHS,
    Role,
    commands_else,
    episode_column,
    roles,
    time_column,
    words,
)
from diagnosis.logs.stamps import Notes, episodes, timed
from diagnosis.logs.together import read_tables
from diagnosis.logs.whole_rows import whole_rows

Ranges = Mapping[str, tuple[float, float, bool]]
"""By joint the ends of its range, and whether it slides: `backends.mjcf.joint_ranges`."""
Columns = dict[tuple[str, str], Role]
"""The column of each joint and kind."""
BEYOND = 1.1
"""A joint's reading may be so many times its range."""
OPEN_LOOP = (
    "the table has commands of torque, current or speed and none of positions: a motion under them "
    "alone drifts from any model within seconds and cannot be replayed; log the target of the loop "
    "that makes them, with its gains, and them as JOINT.feedforward (Nm) or JOINT.reference (rad/s)"
)
"""Why a drive without a loop over positions is refused."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user says of a recording, where the table does not show it."""

    unit: str | None = None
    """Of positions and commands: a key of `ANGLES` or `LENGTHS`."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Columns by what they are, such as `shoulder.command`."""
    drives: Mapping[str, DriveSettings] = field(default_factory=dict)
    """Drives by joint; `*` is every joint."""
    hold: Mapping[str, float] = field(default_factory=dict)
    fix_base: bool = False
    gravity_compensation: bool = False


def pair(robot: Path, tables: Sequence[Path], asked: Asked) -> Log:
    """Put a model and its tables together; raises LogError, which says what to do."""
    xml = read_model(robot)
    mechanism = MjcfMechanism(
        mjcf=robot.name if robot.suffix else f"{robot.name}.xml",
        hold=dict(asked.hold),
        fix_base=asked.fix_base,
        gravity_compensation=float(asked.gravity_compensation),
    )
    return put_together(xml, mechanism, tables, asked)


def put_together(xml: str, mechanism: MjcfMechanism, tables: Sequence[Path], asked: Asked) -> Log:
    """A log of tables and a model that is known; raises LogError."""
    from backends.mjcf import joint_ranges

    ranges, notes = joint_ranges(xml), Notes()
    frame = read_tables(tables, list(ranges), notes)
    if none := [name for name in frame if frame[name].isna().all()]:
        notes.warnings.append(f"{', '.join(none)}: empty in all rows, and not used")
    clock = timed(frame.drop(columns=none), notes)
    joints, columns = readings(clock.frame, ranges, asked)
    joints, whole = whole_rows(joints, clock.time_s, clock.part, notes)
    if not whole.any():
        raise LogError("no row of the table has readings of all joints, and commands before it")
    samples, counts = episodes(clock.of(whole), notes)
    samples = pd.concat([samples, joints[whole][counts].reset_index(drop=True)], axis=1)
    drives = drives_of(asked, [n.partition(".")[2] for n in joints if "command" in n])
    meta = LogMeta(
        schema=1,
        source=f"{', '.join(one.name for one in tables)} of {mechanism.mjcf}",
        mechanism=mechanism.model_copy(update={"joints": {**mechanism.joints, **drives}}),
    )
    log = make_log(meta, samples, xml)
    warnings = (*notes.warnings, *log.warnings)
    return replace(log, warnings=warnings, said=(*notes.said, *columns))


def readings(frame: pd.DataFrame, ranges: Ranges, asked: Asked) -> tuple[pd.DataFrame, list[str]]:
    """The columns of joints under the names and in the units of a log; and what was understood.

    Raises LogError.
    """
    columns, samples, said = _columns(frame, list(ranges), asked), {}, []
    scales = _scales(frame, columns, ranges, asked)
    for (joint, kind), role in columns.items():
        scale, unit = scales[role.column]
        name = name_of(kind, joint, ranges[joint][2])
        samples[name] = pd.to_numeric(frame[role.column], errors="coerce") / scale
        said.append(f"{name} is '{role.column}'" + (f" in {unit}" if unit else ""))
    unused = [n for n in frame.columns if n not in {role.column for role in columns.values()}]
    unused = [n for n in unused if n not in (time_column(unused), episode_column(unused))]
    if "protocol" in unused:
        unused.remove("protocol")
    if unused:
        said.append(f"not used: {', '.join(unused)}")
    return pd.DataFrame(samples), said


def drives_of(asked: Asked, joints: Sequence[str]) -> dict[str, DriveSettings]:
    """What is said of the drives of these joints."""
    every = dict.fromkeys(joints, asked.drives["*"]) if "*" in asked.drives else {}
    return every | {name: one for name, one in asked.drives.items() if name != "*"}


def _columns(frame: pd.DataFrame, joints: Sequence[str], asked: Asked) -> Columns:
    """The column of each joint and kind; raises LogError."""
    found: dict[tuple[str, str], list[Role]] = {}
    known = [role for role in roles(list(frame.columns), joints) if role.kind != "other"]
    for role in known:
        found.setdefault((role.joint, role.kind), []).append(role)
    for place, column in asked.columns.items():
        joint, _, kind = place.rpartition(".")
        if joint not in joints or kind not in KINDS or column not in frame.columns:
            raise LogError(
                f"--column {place}={column}: give JOINT.KIND=COLUMN, of the joints "
                f"{', '.join(joints)}, the kinds {', '.join(KINDS)}, and the table's columns"
            )
        found[joint, kind] = [Role(column=column, joint=joint, kind=kind, unit=_unit_in(column))]
    for joint in joints:
        bare = found.pop((joint, "bare"), [])
        for kind in ("position", "command"):
            if bare and (joint, kind) not in found:
                found[joint, kind], bare = bare, []
    chosen = {place: _only(*place, some) for place, some in found.items()}
    return _with_both(frame, chosen, joints)


def _only(joint: str, kind: str, some: Sequence[Role]) -> Role:
    """The one column; raises LogError where there are several."""
    if len(some) > 1:
        names = " or ".join(f"'{role.column}'" for role in some)
        raise LogError(
            f"which column is the {kind} of {joint}: {names}? Say it with "
            f"--column '{joint}.{kind}={some[0].column}'"
        )
    return some[0]


def _unit_in(column: str) -> str | None:
    have = words(column)
    return next((unit for unit in (*ANGLES, *LENGTHS) if unit in have), None)


def _with_both(frame: pd.DataFrame, chosen: Columns, joints: Sequence[str]) -> Columns:
    """Joints that have both a command and a position; raises LogError where none has."""
    there = {joint for joint, _ in chosen}
    both = [j for j in joints if {(j, "command"), (j, "position")} <= set(chosen)]
    if both:
        return {place: role for place, role in chosen.items() if place[0] in both}
    if not there:
        raise LogError(
            f"no column names a joint of the model, which has {', '.join(joints)}; the table has "
            f"{', '.join(map(str, frame.columns))}; say which is which with "
            f"--column '{joints[0] if joints else 'JOINT'}.command=COLUMN', and so on"
        )
    first = sorted(there)[0]
    if (first, "position") in chosen and commands_else(list(frame.columns)):
        raise LogError(OPEN_LOOP)
    lacks = "command" if (first, "command") not in chosen else "position"
    raise LogError(
        f"no column is the {lacks} of {first}; the table has {', '.join(map(str, frame.columns))}; "
        f"say which with --column '{first}.{lacks}=COLUMN'"
    )


def _scales(
    frame: pd.DataFrame, columns: Columns, ranges: Ranges, asked: Asked
) -> dict[str, tuple[float, str | None]]:
    """What each column is divided by, and its unit in words; raises LogError."""
    found: dict[str, tuple[float, str | None]] = {}
    guessed = {
        slides: _guess(frame, columns, ranges, slides, asked.unit)
        for slides in {ranges[joint][2] for joint, _ in columns}
    }
    for (joint, kind), role in columns.items():
        if kind in ("torque", "push", "feedforward"):
            found[role.column] = 1.0, "N" if ranges[joint][2] else "Nm"
            continue
        unit = asked.unit or role.unit or guessed[ranges[joint][2]]
        sizes = LENGTHS if ranges[joint][2] else ANGLES
        if unit not in sizes:
            raise LogError(
                f"'{role.column}' is in {unit}, of which one does not know how many are a "
                f"{'metre' if ranges[joint][2] else 'turn'}; convert it, or say --unit with one of "
                f"{', '.join(sizes)}"
            )
        speed = kind in ("velocity", "reference")
        found[role.column] = sizes[unit], f"{unit}/s" if speed else unit
    return found


def _guess(
    frame: pd.DataFrame, columns: Columns, ranges: Ranges, slides: bool, given: str | None
) -> str:
    """The unit of columns whose names have none: SI, or what alone fits the joints' ranges."""
    si, other = ("m", "mm") if slides else ("rad", "deg")
    size = LENGTHS[other] if slides else ANGLES[other]
    over, fits = 0, True
    for (joint, kind), role in columns.items():
        if kind not in ("command", "position") or ranges[joint][2] != slides or role.unit:
            continue
        read = np.abs(pd.to_numeric(frame[role.column], errors="coerce").to_numpy(float))
        reach = float(read[np.isfinite(read)].max(initial=0.0))
        room = BEYOND * max(map(abs, ranges[joint][:2]))
        over += reach > room
        fits &= reach / size <= room
    if not over or given:
        return si
    if fits:
        return other
    raise LogError(
        f"positions are beyond the joints' ranges in {si} and in {other}: in which unit are they? "
        f"Say it with --unit"
    )
