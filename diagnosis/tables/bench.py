"""Rows of a test bench: torque and position of joints, without a command."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagnosis.logs._columns import name_of
from diagnosis.logs.foreign import read_table
from diagnosis.logs.log import LogError
from diagnosis.logs.stamps import Notes, timed
from diagnosis.logs.two_files import ON_BENCH, Asked
from diagnosis.tables.joints import joints_of

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


def benches(table: Path, robot: Path | None, asked: Asked) -> tuple[list[Bench], list[str]]:
    """The rows of a table by joint, and what was understood; raises LogError."""
    frame, form = read_table(table)
    notes = Notes()
    clock = timed(frame, notes)
    ranges, rows, weights, columns = joints_of(clock.frame, robot, asked, ON_BENCH)
    found = []
    for joint, (_, _, slides) in ranges.items():
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
