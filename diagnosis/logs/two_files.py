"""A robot's model and its recording, files as they are, put together as a log.

What names and numbers show is taken and said; what they do not is asked for in one sentence.
"""

import re
from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._columns import KINDS
from diagnosis.logs._files import read_model
from diagnosis.logs._meta import DriveSettings, LogError, LogMeta, MjcfMechanism
from diagnosis.logs.log import Log, make_log, name_of
from diagnosis.logs.roles import (
    ANGLES,
    BY_CONSTANT,
    EFFORTS,
    GAINS,
    LENGTHS,
    Role,
    episode_column,
    joint_of,
    roles,
    time_column,
    words,
)
from diagnosis.logs.stamps import Notes, episodes, timed
from diagnosis.logs.together import read_tables
from diagnosis.logs.whole_rows import whole_rows, without_missing_rows
from diagnosis.logs.wrapped import TURN, unwrapped

Ranges = Mapping[str, tuple[float, float, bool]]
"""By joint the ends of its range, and whether it slides: `backends.mjcf.joint_ranges`."""
COUNTED = re.compile(r"(\d+(?:\.\d+)?)/(turn|mm)(?:@(-?\d+(?:\.\d+)?))?")
"""Counts of an encoder, and where its zero is: `4096/turn@2048`, `200/mm`."""
BEYOND = 1.1
"""A joint's reading may be so many times its range."""
LOOSE, LEAST_FOLLOWED = 0.03, 20
"""A follower's reading is off by such a share of its travel, over so many rows, where its coupling
is not the model's."""
FAR_BEYOND = 3.0
"""Readings beyond so many times a joint's range are in another unit."""
ASKED = ("command", "feedforward", "reference")
"""Kinds of which one says what is asked of a joint."""
ON_BENCH = ("torque", "feedforward", "effort")
"""Kinds of which one says what presses on a joint of a test bench."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user says of a recording, where the table does not show it."""

    unit: str | None = None
    """Of positions and commands: a key of `ANGLES` or `LENGTHS`, or as `COUNTED`."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Columns by what they are, such as `shoulder.command`."""
    drives: Mapping[str, DriveSettings] = field(default_factory=dict)
    """Drives by patterns of joints: `*` is every joint, `left_*` those that begin so."""
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


def put_together(
    xml: str | None, mechanism: MjcfMechanism | None, tables: Sequence[Path], asked: Asked
) -> Log:
    """A log of tables and a model that is known, or of none; raises LogError."""
    from backends.mjcf import joint_ranges

    notes = Notes()
    if xml is None:
        ranges = named_joints(read_tables(tables[:1], (), Notes()), asked)
    else:
        ranges = joint_ranges(xml)
    frame = read_tables(tables, list(ranges), notes)
    if none := [name for name in frame if frame[name].isna().all()]:
        _refuse_dead(none, frame, list(ranges))
        notes.warnings.append(f"{', '.join(none)}: empty in all rows, and not used")
    clock = timed(frame.drop(columns=none), notes)
    gains = [role for role in roles(list(clock.frame), list(ranges)) if role.kind in GAINS]
    rest = clock.frame.drop(columns=[role.column for role in gains])
    joints, columns = readings(rest, ranges, asked, draws=xml is None)
    logged = _gains(clock.frame, gains, columns)
    joints, whole = whole_rows(joints, clock.time_s, clock.part, notes)
    if not whole.any():
        raise LogError("no row of the table has readings of all joints, and commands before it")
    samples, at = episodes(clock, whole, notes)
    samples = pd.concat([samples, joints.iloc[at].reset_index(drop=True)], axis=1)
    samples = without_missing_rows(samples, notes)
    read = [n for n in joints if "position" in n]
    drives = drives_of(asked, [n.partition(".")[2] for n in read], logged)
    for name in read:
        target, joint = name.replace("position", "command"), name.partition(".")[2]
        if target not in joints:  # the loop is open: its kp has made torques of what is asked
            samples[target] = samples.groupby("episode")[name].transform("first")
            opened = {"open_loop": True, "kp": None}
            drives[joint] = drives.get(joint, DriveSettings()).model_copy(update=opened)
    source = ", ".join(one.name for one in tables)
    if mechanism is not None:
        source = f"{source} of {mechanism.mjcf}"
        mechanism = mechanism.model_copy(update={"joints": {**mechanism.joints, **drives}})
    if xml is not None:
        notes.warnings += loose(xml, clock.frame, [n.partition(".")[2] for n in read])
    log = make_log(LogMeta(schema=1, source=source, mechanism=mechanism), samples, xml)
    warnings = (*notes.warnings, *log.warnings)
    return replace(log, warnings=warnings, said=(*notes.said, *columns))


def readings(
    frame: pd.DataFrame,
    ranges: Ranges,
    asked: Asked,
    draws: bool = False,
    asks: Sequence[str] = ASKED,
) -> tuple[pd.DataFrame, list[str]]:
    """The columns of joints under the names and in the units of a log; and what was understood.

    `draws`: currents and the like stand for torques, as where only their changes count. `asks`:
    kinds of which a joint needs one. Raises LogError.
    """
    columns, samples, said = _columns(frame, list(ranges), asked, draws, asks), {}, []
    unused = [n for n in frame if n not in {role.column for role in columns}]
    numbers = {r.column: pd.to_numeric(frame[r.column], errors="coerce") for r in columns}
    kinds = {s: [role for role in columns if ranges[role.joint][2] == s] for s in (False, True)}
    units = {s: asked.unit or _guess(numbers, own, ranges) for s, own in kinds.items() if own}
    for role in columns:
        slides = ranges[role.joint][2]
        unit = asked.unit or role.unit or units[slides]
        scale, zero, of = _size(role, asked, unit, slides, draws)
        name = name_of(role.kind, role.joint, slides)
        samples[name] = (numbers[role.column] - zero * (not role.missed)) / scale
        if not role.missed:
            said.append(f"{name} is '{role.column}' in {of}")
    for role in (role for role in columns if role.missed):
        slides = ranges[role.joint][2]
        name, asked_at = (name_of(kind, role.joint, slides) for kind in ("position", "command"))
        # no position comes before its command: an error that is command less position grows ahead
        behind = float((samples[asked_at].diff() * samples[name]).sum()) >= 0.0
        samples[name] = samples[asked_at] + (-1.0 if behind else 1.0) * samples[name]
        said.append(f"{name} is its command {'less' if behind else 'plus'} '{role.column}'")
    hinges = [j for j, (low, high, slides) in ranges.items() if not slides and high - low > TURN]
    said += unwrapped(samples, hinges)
    known = ("protocol", time_column(unused), episode_column(unused))
    if unused := [name for name in unused if name not in known]:
        said.append(f"not used: {', '.join(unused)}")
    return pd.DataFrame(samples), said


def loose(xml: str, frame: pd.DataFrame, joints: Sequence[str]) -> list[str]:
    """Joints that follow one of these by the model, and not by their readings, in words."""
    from backends.mjcf import leaders

    led, found = leaders(xml, joints), list[str]()
    places = ("position", "bare")
    read = {r.joint: r for r in roles(list(frame), [*joints, *led]) if r.kind in places}
    for name, leader in led.items():
        if name in read and leader in read:
            columns = (frame[read[one].column] for one in (leader, name))
            x, y = (pd.to_numeric(column, errors="coerce").to_numpy(float) for column in columns)
            known = np.isfinite(x) & np.isfinite(y)
            if known.sum() < LEAST_FOLLOWED or not np.ptp(x[known]) or not np.ptp(y[known]):
                continue
            off = y[known] - np.polyval(np.polyfit(x[known], y[known], 1), x[known])
            share = float(np.std(off) / np.ptp(y[known]))
            if share > LOOSE:
                found.append(
                    f"{name} follows {leader} in the model, but reads {100 * share:.0f} % of its "
                    "travel beside any line of it: its coupling is loose or soft, or it is moved "
                    "otherwise"
                )
    return found


def _size(
    role: Role, asked: Asked, unit: str, slides: bool, draws: bool
) -> tuple[float, float, str]:
    """How many are one in SI, where their zero is, and what they are in; raises LogError."""
    if KINDS[role.kind] == "torque":
        size, of = EFFORTS.get(role.unit or "", 1.0), "N" if slides else "Nm"
        if draws:
            return size, 0.0, f"{of}, or in its own unit"
        if not BY_CONSTANT & {*words(role.column)}:
            return size, 0.0, of
        drive = _drive_of(asked, role.joint)
        if drive is None or not drive.kp:
            raise LogError(
                f"'{role.column}' is no torque yet: say what one A, one V or the whole duty cycle "
                f"makes at the joint, such as --drive '{role.joint}=kp:0.12' [Nm]"
            )
        return size / drive.kp, 0.0, of
    sizes, counted = LENGTHS if slides else ANGLES, COUNTED.fullmatch(unit)
    size = float(counted[1]) * sizes.get(counted[2], np.nan) if counted else sizes.get(unit, np.nan)
    if not np.isfinite(size):
        raise LogError(
            f"'{role.column}' is in {unit}, of which one does not know how many are a "
            f"{'metre' if slides else 'turn'}: say --unit with one of "
            f"{', '.join(sizes)}, or with the counts and their "
            f"zero, such as {'200/mm' if slides else '4096/turn@2048'}"
        )
    if KINDS[role.kind] == "speed":
        return size, 0.0, f"{unit}/s"
    return size, float(counted[3] or 0.0) if counted else 0.0, unit


def drives_of(
    asked: Asked, joints: Sequence[str], logged: Mapping[str, DriveSettings] | None = None
) -> dict[str, DriveSettings]:
    """What is said of the drives of these joints, the user's words before the table's.

    Raises LogError where they are of no joint.
    """
    for pattern in asked.drives:
        if not any(fnmatchcase(joint, pattern) for joint in joints):
            raise LogError(f"no joint of the log is '{pattern}'; it has {', '.join(joints)}")
    every = {joint: _drive_of(asked, joint) for joint in joints}
    return {**(logged or {}), **{joint: one for joint, one in every.items() if one is not None}}


def _drive_of(asked: Asked, joint: str) -> DriveSettings | None:
    """What is said of a joint's drive, by its name before what patterns say."""
    patterns = [pattern for pattern in asked.drives if fnmatchcase(joint, pattern)]
    said = [
        asked.drives[pattern].model_dump(exclude_unset=True)
        for pattern in sorted(patterns, key=lambda pattern: pattern == joint)
    ]
    return DriveSettings.model_validate(dict(ChainMap(*reversed(said)))) if said else None


def _gains(frame: pd.DataFrame, gains: Sequence[Role], said: list[str]) -> dict[str, DriveSettings]:
    """Drives whose gains stand in every row, as where motors are sent q, dq, tau, kp and kd.

    A gain that changes is not used. `said` gains what was understood.
    """
    found = dict[str, dict[str, float]]()
    for role in gains:
        values = pd.to_numeric(frame[role.column], errors="coerce").dropna().unique()
        if len(values) == 1:
            found.setdefault(role.joint, {})[role.kind] = float(values[0])
            said.append(f"{role.kind} of {role.joint} is {values[0]:g}, of '{role.column}'")
        else:
            said.append(f"not used: '{role.column}', which changes: a drive has one {role.kind}")
    return {joint: DriveSettings.model_validate(every) for joint, every in found.items()}


def named_joints(frame: pd.DataFrame, asked: Asked, asks: Sequence[str] = ("command",)) -> Ranges:
    """Joints that columns name, without a model; one where none is.

    They have a position, and a column of the kinds `asks`. They slide where a column of theirs, or
    what is asked, is in a unit of lengths.
    """
    names = dict.fromkeys(joint_of(str(column)) for column in frame)
    every = {
        joint: roles([n for n in frame if joint_of(str(n)) == joint], [joint]) for joint in names
    }
    kinds = {joint: {role.kind for role in some} for joint, some in every.items()}
    read = {"position", "bare", "error"}
    found = [j for j, have in kinds.items() if have & {*asks} and read & have]
    counted = COUNTED.fullmatch(asked.unit or "")
    long = (counted[2] if counted else asked.unit) in LENGTHS
    lengths = {j: long or any(role.unit in LENGTHS for role in every[j]) for j in found}
    return {j: (-np.inf, np.inf, lengths[j]) for j in found} or {"joint": (-np.inf, np.inf, long)}


def _refuse_dead(empty: Sequence[str], frame: pd.DataFrame, joints: Sequence[str]) -> None:
    """Raise LogError where a joint has commands, and readings that are empty throughout."""
    every = roles(list(frame.columns), joints)
    alive = [role for role in every if role.column not in empty]
    asked = {role.joint for role in alive if role.kind in (*ASKED, "effort")}
    read = {role.joint for role in alive if role.kind in ("position", "bare")}
    for role in every:
        if role.kind == "position" and role.joint in asked - read:
            raise LogError(
                f"'{role.column}' is empty in all rows, while {role.joint} is commanded: a dead "
                "sensor; mend it, or give the table without this joint's commands and --hold it "
                "where it stood"
            )


def _columns(
    frame: pd.DataFrame, joints: Sequence[str], asked: Asked, draws: bool, asks: Sequence[str]
) -> list[Role]:
    """The column of each joint and kind; raises LogError."""
    found: dict[tuple[str, str], list[Role]] = {}
    for role in roles(list(frame.columns), joints):
        if role.kind not in ("other", *GAINS):
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
        bare, effort, error, draw = (
            found.pop((joint, kind), []) for kind in ("bare", "effort", "error", "draw")
        )
        if draw and draws and (joint, "torque") not in found:
            found[joint, "torque"] = [replace(role, kind="torque") for role in draw]
        if effort and not any((joint, kind) in found for kind in asks):
            found[joint, "feedforward"] = [replace(role, kind="feedforward") for role in effort]
        if bare and (joint, "position") not in found:
            found[joint, "position"] = [replace(role, kind="position") for role in bare]
        elif bare and not any((joint, kind) in found for kind in asks):
            found[joint, "command"] = [replace(role, kind="command") for role in bare]
        if error and (joint, "command") in found and (joint, "position") not in found:
            found[joint, "position"] = [replace(r, kind="position", missed=True) for r in error]
    for (joint, kind), some in found.items():
        if kind == "position":  # 'q_current' is a position or a current
            some[:] = [r for r in some if "current" not in words(r.column)] or some
        if len(some) > 1:
            names = " or ".join(f"'{role.column}'" for role in some)
            raise LogError(
                f"which column is the {kind} of {joint}: {names}? Say it with "
                f"--column '{joint}.{kind}={some[0].column}'"
            )
    asked_of = {joint for joint, kind in found if kind in asks}
    if both := {joint for joint in asked_of if (joint, "position") in found}:
        return [some[0] for (joint, _), some in found.items() if joint in both]
    first = min((joint for joint, _ in found), default=joints[0] if joints else "JOINT")
    lacks = "position" if (first, asks[0]) in found else asks[0]
    no, which, more = f"is the {lacks} of {first}", "which", ""
    if not found:
        no, more = f"names a joint of the model, which has {', '.join(joints)}", ", and so on"
        which = "which is which"
    raise LogError(
        f"no column {no}; the table has {', '.join(map(str, frame.columns))}; say {which} with "
        f"--column '{first}.{lacks}=COLUMN'{more}"
    )


def _guess(numbers: Mapping[str, pd.Series], columns: Sequence[Role], ranges: Ranges) -> str:
    """The unit of columns whose names have none: SI, or what alone fits the joints' ranges.

    A joint may be a little beyond its range: that alone tells no unit. Raises LogError.
    """
    si, other = ("m", "mm") if ranges[columns[0].joint][2] else ("rad", "deg")
    beyond, fits, per = dict[str, float](), True, (ANGLES | LENGTHS)[other]
    for role in columns:
        if role.kind in ("command", "position") and not role.unit:
            read = numbers[role.column].replace([np.inf, -np.inf], np.nan).abs().max()
            room = max(map(abs, ranges[role.joint][:2]))
            beyond[role.column] = read / room if room > 0.0 else 0.0
            fits &= not read / per > BEYOND * room
    most = max(beyond, key=lambda name: beyond[name], default="")
    if not most or not beyond[most] > BEYOND:
        return si
    if not fits or beyond[most] < FAR_BEYOND:
        either = f"and in {other}" if not fits else f"by little, and not in {other}"
        raise LogError(
            f"positions are beyond the joints' ranges in {si} {either}: '{most}' reads up to "
            f"{numbers[most].abs().max():.3g}; in which unit are they? Say it with --unit"
        )
    return other
