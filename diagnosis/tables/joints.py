"""The joints of a table that is no log: their rows, and what holds their links in the model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._columns import name_of
from diagnosis.logs._files import read_model
from diagnosis.logs.foreign import read_table
from diagnosis.logs.log import DriveSettings, LogError, as_log_errors
from diagnosis.logs.roles import UNITS, words
from diagnosis.logs.stamps import Notes, timed
from diagnosis.logs.two_files import ON_BENCH, Asked, drives_of, named_joints, readings
from diagnosis.replay.dynamics import holding

LEAST = 100
"""A sweep on a bench has more rows."""


@dataclass(frozen=True, kw_only=True)
class Rows:
    """One joint's rows."""

    joint: str
    low: float
    high: float
    """Its range [rad]; infinite without a model."""
    slides: bool
    """Whether all is in m and N instead of rad and Nm."""
    drive: DriveSettings
    """What is known of its drive."""
    rows: pd.DataFrame
    """Columns by their kinds, such as `position` [rad] and `torque` [Nm]; and `weight`, the torque
    that holds the links there, where a model says it."""


def joints_of(
    frame: pd.DataFrame, robot: Path | None, asked: Asked, asks: Sequence[str]
) -> tuple[list[Rows], list[str]]:
    """Joints with a position and one of the kinds `asks`, and what is said; raises LogError."""
    from backends.mjcf import file_drives, joint_ranges

    if robot is None and asked.unit is None and not any(UNITS & {*words(n)} for n in frame):
        raise LogError("the columns name no unit; say it with --unit, or give --robot")
    xml = None if robot is None else read_model(robot)
    with as_log_errors(f"{robot}: "):
        ranges = named_joints(frame, asked, asks) if xml is None else joint_ranges(xml)
        table, said = readings(frame, ranges, asked, asks=asks)
        names = [n.partition(".")[2] for n in table if n.startswith("position")]
        weights = {} if xml is None else _weights(xml, table, names, asked)
        files = {} if xml is None else file_drives(xml)
    drives, found = drives_of(asked, names), []
    for joint in names:
        own = [n for n in table if n.partition(".")[2] == joint]
        rows = table[own].set_axis([n.partition("_")[0] for n in own], axis=1)
        rows = rows.assign(weight=weights[joint]) if joint in weights else rows
        drive, (low, high, slides) = drives.get(joint, DriveSettings()), ranges[joint]
        if drive.kp is None and joint in files:
            drive = drive.model_copy(update={"kp": files[joint].kp})
        one = Rows(joint=joint, low=low, high=high, slides=slides, drive=drive, rows=rows)
        found.append(one)
    return found, said


def _weights(
    xml: str, rows: pd.DataFrame, names: Sequence[str], asked: Asked
) -> dict[str, np.ndarray]:
    from backends.mjcf import mechanism

    drive = DriveSettings(kp=1.0, limit=1.0)  # any
    drives, hold, fixed = dict.fromkeys(names, drive), asked.hold, asked.fix_base
    spec = mechanism(xml, drives, held=hold, fix_base=fixed, geared=False)
    driven = [body.joint for body in spec.hand.driven]
    q = np.stack([rows[name_of("position", one.name, one.slides)] for one in driven], axis=1)
    weights = holding(spec, np.nan_to_num(q))
    return dict(zip(spec.hand.joint_names, weights.T, strict=True))


def benches(table: Path, robot: Path | None, asked: Asked) -> tuple[list[Rows], list[str]]:
    """Rows of a test bench by joint, and what was understood; raises LogError.

    They have columns `time_s`, `position`, `torque` and, where a model says it, `weight`.
    """
    frame, form = read_table(table)
    notes = Notes()
    clock = timed(frame, notes)
    every, said = joints_of(clock.frame, robot, asked, ON_BENCH)
    found = []
    for one in every:
        rows = one.rows.rename(columns={} if "torque" in one.rows else {"feedforward": "torque"})
        kinds = [kind for kind in ("position", "torque", "weight") if kind in rows]
        rows = rows[kinds].assign(time_s=clock.time_s).dropna()
        if len(rows) < LEAST:
            raise LogError(
                f"{one.joint} has {len(rows)} rows with torque and position; needed: {LEAST}"
            )
        found.append(replace(one, rows=rows))
    return found, [f"{table.name}: {form}, {len(frame)} rows", *notes.said, *notes.warnings, *said]
