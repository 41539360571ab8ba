"""Rows of a test bench: torque and position of joints, without a command."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

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
    """One joint's rows."""

    joint: str
    slides: bool
    rows: pd.DataFrame
    """Columns `time_s`, `position` [rad], `torque` [Nm], of slides [m, N]; and `weight`, what holds
    the links there, where a model says it."""


def benches(table: Path, robot: Path | None, asked: Asked) -> tuple[list[Bench], list[str]]:
    """The rows of a table by joint, and what was understood; raises LogError."""
    frame, form = read_table(table)
    notes = Notes()
    clock = timed(frame, notes)
    ranges, rows, weights, columns = joints_of(clock.frame, robot, asked, ON_BENCH)
    found = []
    for joint, (_, _, slides) in ranges.items():
        measured, wanted = (name_of(kind, joint, slides) for kind in ("torque", "feedforward"))
        own = rows[[name_of("position", joint, slides), measured if measured in rows else wanted]]
        own = own.set_axis(["position", "torque"], axis=1).assign(time_s=clock.time_s)
        own = (own.assign(weight=weights[joint]) if joint in weights else own).dropna()
        if len(own) < LEAST:
            raise LogError(f"{joint} has {len(own)} rows with torque and position; needed: {LEAST}")
        found.append(Bench(joint=joint, slides=slides, rows=own))
    said = [f"{table.name}: {form}, {len(frame)} rows", *notes.said, *notes.warnings, *columns]
    return found, said
