"""Rows of a test bench: torque and position of joints, without a command."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagnosis.logs._columns import name_of
from diagnosis.logs._files import read_model
from diagnosis.logs.foreign import read_table
from diagnosis.logs.log import LogError, as_log_errors
from diagnosis.logs.roles import UNITS, words
from diagnosis.logs.stamps import Notes, timed
from diagnosis.logs.two_files import ON_BENCH, Asked, named_joints, readings
from diagnosis.tables.rests import of_model

LEAST = 100
"""A sweep on a bench has more rows."""


@dataclass(frozen=True, kw_only=True)
class Bench:
    """One joint's rows: T of them."""

    joint: str
    slides: bool
    time_s: np.ndarray
    position: np.ndarray
    """In rad; of slides in m."""
    torque: np.ndarray
    """In Nm; of slides in N."""
    weight: np.ndarray | None
    """What holds the links there [Nm]; None: no model says it."""

    @property
    def units(self) -> tuple[float, str, str]:
        """What a position is times, to be said; its unit, and that of torques."""
        return (1e3, "mm", "N") if self.slides else (180 / np.pi, "deg", "Nm")


def benches(table: Path, robot: Path | None, asked: Asked) -> tuple[list[Bench], list[str]]:
    """The rows of a table by joint, and what was understood; raises LogError."""
    from backends.mjcf import joint_ranges

    frame, form = read_table(table)
    if robot is None and asked.unit is None and not any(UNITS & {*words(n)} for n in frame):
        raise LogError("the columns name no unit; say it with --unit, or give --robot")
    notes, xml = Notes(), None if robot is None else read_model(robot)
    clock = timed(frame, notes)
    with as_log_errors(f"{robot}: "):
        ranges = named_joints(clock.frame, asked, ON_BENCH) if xml is None else joint_ranges(xml)
        rows, columns = readings(clock.frame, ranges, asked, asks=ON_BENCH)
    names = [n.partition(".")[2] for n in rows if n.startswith("position")]
    weights = {} if xml is None else of_model(xml, rows, names, {}, asked)[1]
    found = []
    for joint in names:
        slides = ranges[joint][2]
        position = rows[name_of("position", joint, slides)]
        measured, wanted = (name_of(kind, joint, slides) for kind in ("torque", "feedforward"))
        torque = rows[measured if measured in rows else wanted]
        keep = (position.notna() & torque.notna()).to_numpy()
        if keep.sum() < LEAST:
            raise LogError(
                f"{joint} has {keep.sum()} rows with torque and position; needed: {LEAST}"
            )
        found.append(
            Bench(
                joint=joint,
                slides=slides,
                time_s=clock.time_s[keep],
                position=position[keep].to_numpy(),
                torque=torque[keep].to_numpy(),
                weight=weights[joint][keep] if joint in weights else None,
            )
        )
    said = [f"{table.name}: {form}, {len(frame)} rows", *notes.said, *notes.warnings, *columns]
    return found, said
