"""The joints of a table that is no log: their columns, and what holds their links in the model."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._columns import name_of
from diagnosis.logs._files import read_model
from diagnosis.logs.log import DriveSettings, LogError, as_log_errors
from diagnosis.logs.roles import UNITS, words
from diagnosis.logs.two_files import Asked, Ranges, named_joints, readings
from diagnosis.replay.dynamics import bias_torques


def joints_of(
    frame: pd.DataFrame, robot: Path | None, asked: Asked, asks: Sequence[str]
) -> tuple[Ranges, pd.DataFrame, dict[str, np.ndarray], list[str]]:
    """Joints with a position and one of the kinds `asks`, their columns, weights, and what is said.

    Columns as in a log; weights are the torques that hold the links (T,), by joint, none without a
    model. Raises LogError.
    """
    from backends.mjcf import joint_ranges

    if robot is None and asked.unit is None and not any(UNITS & {*words(n)} for n in frame):
        raise LogError("the columns name no unit; say it with --unit, or give --robot")
    xml = None if robot is None else read_model(robot)
    with as_log_errors(f"{robot}: "):
        ranges = named_joints(frame, asked, asks) if xml is None else joint_ranges(xml)
        rows, said = readings(frame, ranges, asked, asks=asks)
        names = [n.partition(".")[2] for n in rows if n.startswith("position")]
        weights = {} if xml is None else _weights(xml, rows, names, asked)
    return {name: ranges[name] for name in names}, rows, weights, said


def _weights(
    xml: str, rows: pd.DataFrame, names: Sequence[str], asked: Asked
) -> dict[str, np.ndarray]:
    from backends.mjcf import mechanism

    drive = DriveSettings(kp=1.0, limit=1.0)  # any
    drives, hold, fixed = dict.fromkeys(names, drive), asked.hold, asked.fix_base
    spec = mechanism(xml, drives, held=hold, fix_base=fixed, geared=False)
    driven = [body.joint for body in spec.hand.driven]
    q = np.stack([rows[name_of("position", one.name, one.slides)] for one in driven], axis=1)
    weights = bias_torques(spec, np.nan_to_num(q), np.zeros_like(q))
    return dict(zip(spec.hand.joint_names, weights.T, strict=True))
