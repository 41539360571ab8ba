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
    samples, at = episodes(clock, whole, notes)
    samples = pd.concat([samples, joints.iloc[at].reset_index(drop=True)], axis=1)
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
    unused = [n for n in frame if n not in {role.column for role in columns}]
    numbers = {r.column: pd.to_numeric(frame[r.column], errors="coerce") for r in columns}
    guessed = {
        slides: _guess(numbers, [r for r in columns if ranges[r.joint][2] == slides], ranges)
        if not asked.unit
        else None
        for slides in {ranges[role.joint][2] for role in columns}
    }
    for role in columns:
        slides = ranges[role.joint][2]
        sizes, unit = LENGTHS if slides else ANGLES, asked.unit or role.unit or guessed[slides]
        name, scale, of = name_of(role.kind, role.joint, slides), 1.0, "N" if slides else "Nm"
        if KINDS[role.kind] != "torque":
            if unit not in sizes:
                raise LogError(
                    f"'{role.column}' is in {unit}, of which one does not know how many are a "
                    f"{'metre' if slides else 'turn'}; convert it, or say --unit with one of "
                    f"{', '.join(sizes)}"
                )
            scale, of = sizes[unit], f"{unit}/s" if KINDS[role.kind] == "speed" else unit
        samples[name] = numbers[role.column] / scale
        said.append(f"{name} is '{role.column}' in {of}")
    known = ("protocol", time_column(unused), episode_column(unused))
    if unused := [name for name in unused if name not in known]:
        said.append(f"not used: {', '.join(unused)}")
    return pd.DataFrame(samples), said


def drives_of(asked: Asked, joints: Sequence[str]) -> dict[str, DriveSettings]:
    """What is said of the drives of these joints."""
    every = dict.fromkeys(joints, asked.drives["*"]) if "*" in asked.drives else {}
    return every | {name: one for name, one in asked.drives.items() if name != "*"}


def _columns(frame: pd.DataFrame, joints: Sequence[str], asked: Asked) -> list[Role]:
    """The column of each joint and kind; raises LogError."""
    found: dict[tuple[str, str], list[Role]] = {}
    for role in roles(list(frame.columns), joints):
        if role.kind != "other":
            found.setdefault((role.joint, role.kind), []).append(role)
    for place, column in asked.columns.items():
        joint, _, kind = place.rpartition(".")
        if joint not in joints or kind not in KINDS or column not in frame.columns:
            raise LogError(
                f"--column {place}={column}: give JOINT.KIND=COLUMN, of the joints "
                f"{', '.join(joints)}, the kinds {', '.join(KINDS)}, and the table's columns"
            )
        unit = next((unit for unit in (*ANGLES, *LENGTHS) if unit in words(column)), None)
        found[joint, kind] = [Role(column=column, joint=joint, kind=kind, unit=unit)]
    for joint in joints:
        bare = found.pop((joint, "bare"), [])
        for kind in ("position", "command"):
            if bare and (joint, kind) not in found:
                found[joint, kind], bare = [replace(role, kind=kind) for role in bare], []
    for (joint, kind), some in found.items():
        if len(some) > 1:
            names = " or ".join(f"'{role.column}'" for role in some)
            raise LogError(
                f"which column is the {kind} of {joint}: {names}? Say it with "
                f"--column '{joint}.{kind}={some[0].column}'"
            )
    _refuse_open_loop(frame, found, joints)
    both = {j for j, _ in found if (j, "command") in found and (j, "position") in found}
    return [some[0] for (joint, _), some in found.items() if joint in both]


def _refuse_open_loop(
    frame: pd.DataFrame, found: Mapping[tuple[str, str], object], joints: Sequence[str]
) -> None:
    """Raise LogError where no joint has both a command and a position."""
    has = f"the table has {', '.join(map(str, frame.columns))}; say which"
    if not found:
        raise LogError(
            f"no column names a joint of the model, which has {', '.join(joints)}; {has} is which "
            f"with --column '{joints[0] if joints else 'JOINT'}.command=COLUMN', and so on"
        )
    if any((j, "command") in found and (j, "position") in found for j in joints):
        return
    first = min(joint for joint, _ in found)
    if (first, "position") in found and commands_else(list(frame.columns)):
        raise LogError(OPEN_LOOP)
    lacks = "command" if (first, "command") not in found else "position"
    raise LogError(
        f"no column is the {lacks} of {first}; {has} with --column '{first}.{lacks}=COLUMN'"
    )


def _guess(numbers: Mapping[str, pd.Series], columns: Sequence[Role], ranges: Ranges) -> str:
    """The unit of columns whose names have none: SI, or what alone fits the joints' ranges."""
    si, other = ("m", "mm") if ranges[columns[0].joint][2] else ("rad", "deg")
    over, fits = False, True
    for role in columns:
        if role.kind in ("command", "position") and not role.unit:
            read = numbers[role.column].replace([np.inf, -np.inf], np.nan).abs().max()
            room = BEYOND * max(map(abs, ranges[role.joint][:2]))
            over |= read > room
            fits &= not read / (ANGLES | LENGTHS)[other] > room
    if over and not fits:
        raise LogError(
            f"positions are beyond the joints' ranges in {si} and in {other}: in which unit are "
            "they? Say it with --unit"
        )
    return other if over else si
