"""What is known of the drives of a user's robot, and from where: its file, log.yaml, or nowhere.

Where both say something, log.yaml counts.
"""

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.logs.log import DriveSettings, Log, LogError, MjcfMechanism, as_log_errors

FREE_LIMIT = 2.0
"""A drive without a limit gets this multiple of the torque at the log's largest error."""
APART = 0.2
"""Two values of one number contradict each other beyond this share."""
GUESS_SD = 1.5
"""Standard deviation of the logarithm of an inertia that neither file nor log.yaml knows."""
COLUMNS = {
    "kp": "drive.kp_nm_rad",
    "kd": "drive.kd_nms_rad",
    "limit": "drive.torque_limit_nm",
    "armature": "drive.rotor_inertia_kgm2",
}
"""Numbers that a file has as well, under the names of the spec."""
NUMBERS = tuple(COLUMNS)
UNSURE = COLUMNS | {"ki": "loop.integral_hz", "speed_integral": "loop.speed_integral_hz"}
"""Numbers that may have an uncertainty of their own, under the names of the spec."""
IN_LOG, NOWHERE = "log.yaml", "unknown"


@dataclass(frozen=True, kw_only=True)
class KnownDrive:
    """The drive of one joint."""

    drive: DriveSettings
    """What log.yaml says of it, else the file; the limit and the armature may be unknown."""
    origins: dict[str, str]
    """Where each of `NUMBERS` comes from: a file, or `NOWHERE`."""
    differing: tuple[str, ...]
    """Numbers of which file and log.yaml say different things, in words."""


NO_MODEL = (
    "this log names no mechanism; write its MJCF or hand into log.yaml, or compare it with logs of "
    "the same motion while nothing was wrong: bench diagnose LOG --healthy NORMAL"
)


def model_of(log: Log) -> tuple[str, MjcfMechanism]:
    """The text of a log's model, and what log.yaml says of it; raises LogError without one."""
    settings = log.meta.mechanism
    if settings is None:
        raise LogError(NO_MODEL)
    if not isinstance(settings, MjcfMechanism) or log.mjcf_xml is None:
        raise LogError("this log's mechanism is a hand known by name, not an MJCF file")
    return log.mjcf_xml, settings


def known_drives(log: Log) -> dict[str, KnownDrive]:
    """The drives of all logged joints; raises LogError where the model lacks one, or its gain."""
    from backends.mjcf import file_drives

    xml, settings = model_of(log)
    with as_log_errors(f"{settings.mjcf}: "):
        files = file_drives(xml)
    _require_joints(log, settings.mjcf, list(files))
    found = {
        name: _known(settings, name, files[name], log.has("reference", name)) for name in log.joints
    }
    without = [name for name, one in found.items() if one.drive.kp is None]
    if without:
        first = f"{{{without[0]}: {{kp: 60, kd: 1.5}}}}"
        raise LogError(
            f"{settings.mjcf} has no position actuator for {', '.join(without)}, and log.yaml has "
            f"no kp: write the drives there, such as `joints: {first}` [Nm/rad, Nms/rad], or give "
            f"them with --drive '{without[0]}=kp:60,kd:1.5'; if its commands are torques, say "
            f"--column '{without[0]}.feedforward=COLUMN'"
        )
    return found


def servos(log: Log) -> dict[str, DriveSettings]:
    """The drives of all logged joints, with a limit that the log never reaches where none is known.

    Raises LogError.
    """
    found = {}
    for name, one in known_drives(log).items():
        drive, lead = one.drive, one.drive.lead
        numbers = {
            "limit": drive.limit or _ample(log, name, drive),
            "kd": (drive.kd or 0.0) + drive.back_emf,
            "lead": float(log.has("reference", name)) if lead is None else lead,
        }
        found[name] = drive.model_copy(update=numbers)
    return found


def uncertainties(log: Log) -> dict[tuple[str, str], float]:
    """Relative uncertainty of numbers that have their own, by joint and number of the spec."""
    if not isinstance(log.meta.mechanism, MjcfMechanism):
        return {}
    found = {}
    for name, one in known_drives(log).items():
        if one.drive.armature is None:
            found[name, COLUMNS["armature"]] = GUESS_SD
        said = one.drive.uncertainty.items()
        found |= {(name, UNSURE[number]): size for number, size in said}
    return found


def contradictions(log: Log) -> Iterator[str]:
    """What file and log.yaml say differently, and what neither says, in words."""
    drives = known_drives(log)
    for name, one in drives.items():
        for text in one.differing:
            yield f"{name}: {text}; log.yaml counts"
    unknown = [name for name, one in drives.items() if one.drive.armature is None]
    if unknown:
        yield (
            f"the inertia of the motors of {', '.join(unknown)} is unknown, and left free: if you "
            "know it, write `armature` in log.yaml (the rotor's times the gear ratio squared)"
        )


def _known(settings: MjcfMechanism, name: str, file: Any, has_reference: bool) -> KnownDrive:
    """One joint's drive; its gain is None where neither says it."""
    said = settings.joints.get(name, DriveSettings())
    numbers, origins, differing = {}, {}, []
    if said.open_loop:
        file = replace(file, kp=1.0, kd=file.kd if has_reference else 0.0)
    for number in NUMBERS:
        here, there = getattr(said, number), getattr(file, number) or None
        numbers[number] = there if here is None else here
        known = IN_LOG if here is not None else settings.mjcf
        origins[number] = NOWHERE if numbers[number] is None else known
        if here is not None and there is not None and abs(here - there) > APART * abs(there):
            differing.append(f"{number} is {there:g} in {settings.mjcf} and {here:g} in log.yaml")
    drive = said.model_copy(update=numbers | {"kd": numbers["kd"] or 0.0})
    return KnownDrive(drive=drive, origins=origins, differing=tuple(differing))


def _require_joints(log: Log, file: str, known: Sequence[str]) -> None:
    """Raise LogError where the model lacks joints of the log."""
    strange = [name for name in log.joints if name not in known]
    if not strange:
        return
    near = {name: difflib.get_close_matches(name, known, n=1) for name in strange}
    hints = ", ".join(f"'{found[0]}' for {name}" for name, found in near.items() if found)
    said = f"; did you mean {hints}?" if hints else ""
    raise LogError(
        f"{file} has no joint {', '.join(strange)}, which the log has; it has: "
        f"{', '.join(known) or 'none'}{said}; rename or remove the columns"
    )


def _ample(log: Log, joint: str, drive: DriveSettings) -> float:
    """A limit that the log never reaches; at least 1e-6 Nm."""
    error = log.samples[log.column("command", joint)] - log.samples[log.column("position", joint)]
    kp, by_error = drive.kp or 0.0, float(np.abs(error).max())
    most, gain = (0.0, kp) if drive.open_loop else (kp * by_error, 1.0)
    for kind, by in (("feedforward", gain), ("reference", drive.kd or 0.0)):
        if log.has(kind, joint):
            most += by * float(np.abs(log.samples[log.column(kind, joint)]).max())
    return max(FREE_LIMIT * most, 1e-6)
