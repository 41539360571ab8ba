"""A log from a user's robot: from a folder, or from its model and its table; and what it says."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from pydantic import ValidationError

from benchmark.errors import UsageError
from benchmark.gap.asked import Source
from benchmark.parts.extras import install_command
from diagnosis.logs.log import (
    DriveSettings,
    HandMechanism,
    Log,
    is_log,
    read_log,
    write_log,
)
from diagnosis.logs.ros import is_bag
from diagnosis.logs.servos import servo
from diagnosis.logs.two_files import Asked, pair, put_together
from diagnosis.replay.alignment import with_moments
from diagnosis.replay.nominal import left_out, mjcf_world
from diagnosis.replay.robot import NUMBERS, contradictions, known_drives
from files.tables import give_back

FOLDER = "log"
"""Where the log of two files is written, within the folder of the results."""
READABLE = 100_000
"""Rows of a table that one may want to read, as CSV."""
FORM = "JOINT=kp:60+-20%,kd:1.5,limit:12,armature:0.01"


@dataclass(frozen=True, kw_only=True)
class Read:
    """A log in its folder, and what was understood of two files."""

    folder: Path
    log: Log
    said: tuple[str, ...] = field(default=())


def read(source: Source, out: Path, force: bool) -> Read:
    """The log of a source; that of tables is written to a folder in `out`.

    Tables without a robot make a log that can only be compared with healthy ones.

    Raises UsageError, or LogError for a log that cannot be used.
    """
    tables = source.tables
    if source.folder is not None and source.folder.is_file() and not tables:
        tables = (source.folder,)
    elif source.folder is not None:
        if source.folder.is_file() and source.tables:
            raise UsageError(
                f"{source.folder} is one table too many: say --log before each, or quote a name "
                "with *, such as --log 'run/*.csv'"
            )
        if source.robot or source.tables:
            raise UsageError("give LOG, or --robot and --log, not both")
        return Read(folder=source.folder, log=read_log(source.folder))
    if not tables:
        raise UsageError("--log TABLE is missing; give it, or LOG, the folder of a log")
    _require_reader(tables)
    asked, folder = asked_of(source), out / FOLDER
    if source.robot is None:
        log = made = put_together(None, None, tables, asked)
    else:
        made = pair(source.robot, tables, asked)
        known_drives(made)
        log = with_moments(made)
    write_log(log, folder, "csv" if len(log.samples) <= READABLE else "parquet", force=force)
    give_back()
    return Read(folder=folder, log=log, said=made.said)


def read_beside(path: Path, source: Source, today: Log) -> Log:
    """The log in a folder, or of tables that the robot of today's log recorded at another time.

    Raises UsageError, or LogError.
    """
    mechanism = today.meta.mechanism
    is_table = path.exists() or path.suffix
    if is_log(path) or not is_table or isinstance(mechanism, HandMechanism):
        return read_log(path)
    _require_reader([path])
    made = put_together(today.mjcf_xml, mechanism, [path], asked_of(source))
    return with_moments(made)


def _require_reader(tables: Sequence[Path]) -> None:
    """Raise UsageError where what reads recordings of ROS is not installed."""
    for table in tables:
        if is_bag(table) and find_spec("rosbags") is None:
            raise UsageError(
                f"{table} is a recording of ROS; to read it, run: {install_command('ros')}"
            )


def understood(log: Log) -> Iterator[str]:
    """What is known of a robot's joints and drives, from where, and what is left out, by line."""
    if isinstance(log.meta.mechanism, HandMechanism):
        yield f"a hand known by name: {log.meta.mechanism.hand}"
        return
    if log.meta.mechanism is None:
        yield "no model: the log is compared with healthy ones; --robot MODEL gives one"
        yield from (f"warning: {text}" for text in log.warnings)
        return
    world = mjcf_world(log)
    slides = {body.joint.name: body.joint.slides for body in world.hand.driven}
    for name, known in known_drives(log).items():
        drive = known.drive
        units = ("N/m", "Ns/m", "N", "kg") if slides[name] else ("Nm/rad", "Nms/rad", "Nm", "kg m²")
        values = (drive.kp, drive.kd, drive.limit, drive.armature)
        numbers = ", ".join(
            f"{number} {value:g} {unit} ({known.origins[number]})"
            if value is not None
            else f"{number} unknown"
            for number, value, unit in zip(NUMBERS, values, units, strict=True)
        )
        kind = "slide" if slides[name] else "hinge"
        law = "no loop on the position" if drive.open_loop else "PD law on the joint"
        yield f"{name}, a {kind}: {law}, {numbers}{_more(drive)}"
    yield from contradictions(log)
    yield from (f"not simulated: {text}" for text in left_out(log))
    yield from (f"warning: {text}" for text in log.warnings)


def _more(drive: DriveSettings) -> str:
    """What a drive does beside the PD law, and how unsure its numbers are, in words."""
    unsure = {k: f"{k} +- {100 * size:.3g} %" for k, size in drive.uncertainty.items()}
    said = [f"{name} {value:g}" for name, value in drive.more.items()]
    return "".join(f", {text}" for text in (*said, *unsure.values()))


def asked_of(source: Source) -> Asked:
    """The user's own words as data; raises UsageError."""
    columns = dict(_pair(text, "--column", "JOINT.KIND=COLUMN") for text in source.columns)
    hold = {
        name: _number(value, "--hold")
        for name, value in (_pair(text, "--hold", "JOINT=POSITION") for text in source.hold)
    }
    return Asked(
        unit=source.unit,
        columns=columns,
        drives=_drives(source),
        hold=hold,
        fix_base=source.fix_base,
        gravity_compensation=source.gravity_compensation,
    )


def _drives(source: Source) -> dict[str, DriveSettings]:
    """Drives by pattern: servos that are known, and what is said of drives beside them."""
    found: dict[str, dict] = {}
    for text in source.servos:
        name, sign, joint = text.partition("@")
        if not (sign and joint):
            raise UsageError(f"--servo is '{text}'; allowed: NAME@JOINT, such as sts3215@*")
        found[joint] = servo(name).model_dump(exclude_defaults=True)
    for text in source.drives:
        joint, numbers = _pair(text, "--drive", FORM)
        pairs = (part.partition(":") for part in numbers.split(","))
        said = {key.strip(): value.strip() for key, _, value in pairs}
        found[joint] = found.get(joint, {}) | said
    drives = {}
    for joint, one in found.items():
        try:
            drives[joint] = DriveSettings.model_validate(one)
        except ValidationError as error:
            wrong = error.errors()[0]
            raise UsageError(
                f"--drive of {joint}: {'.'.join(map(str, wrong['loc']))} is "
                f"'{wrong['input']}', {wrong['msg'].lower()}; allowed: {FORM}, and "
                f"{', '.join(DriveSettings.model_fields)}"
            ) from None
    return drives


def _pair(text: str, option: str, form: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not (sign and name and value):
        raise UsageError(f"{option} is '{text}'; allowed: {form}")
    return name, value


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{option} has '{text}'; allowed: a number") from None
