"""What a table of targets and readings at rest says, joint by joint: a regression, and its limits.

    reading - target = zero + scale target + sag tau + band d + play s

with tau the torque that the drive holds (weight less a known load), d the side that the joint came
from and s the side that the torque presses on. Zero, half band and half play are in rad, sag in
rad/Nm; of slides in m and m/N.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs.foreign import read_table
from diagnosis.logs.log import LogError
from diagnosis.logs.roles import joint_of
from diagnosis.logs.two_files import Asked
from diagnosis.tables.joints import Rows, joints_of
from diagnosis.tables.terms import Term, regress

LEAST_RAD, FLOOR_RAD = 1e-3, 1e-4
"""A term that moves readings by less is none; no reading at rest is surer [rad; m]."""
FAR = 3.0
"""Targets so many times beyond a joint's range are in another unit."""


def rests(table: Path, robot: Path | None, asked: Asked) -> tuple[list[Rows], list[str]]:
    """The rows of a table by joint, and what was understood; raises LogError.

    They have columns `target` and `reading` [rad]; and `torque`, what the drive holds [Nm], where a
    model or a load says it; of slides [m, N].
    """
    frame, form = read_table(table)
    frame = frame.rename(columns={n: n.replace("load", "push") for n in map(str, frame)})
    if robot is None:
        frame = frame.rename(columns={n: f"joint {n}" for n in frame if joint_of(n) == "joint"})
    every, columns = joints_of(frame, robot, asked, ("command",))
    found = []
    for one in every:
        own = pd.DataFrame({"target": one.rows["command"], "reading": one.rows["position"]})
        there = np.isfinite(own).all(axis=1)
        if "weight" in one.rows or "push" in one.rows:
            load = np.nan_to_num(one.rows.get("push", 0.0))
            own["torque"] = one.rows.get("weight", 0.0) - load
        one = replace(one, rows=own[there])
        if robot is not None:
            _refuse_far(one)
        found.append(one)
    said = f"{table.name}: {form}, {len(frame)} rows at rest, in the order they were reached"
    return found, [said, *columns]


def _refuse_far(one: Rows) -> None:
    """Raise LogError for targets so far beyond a joint's range that they are in another unit."""
    limited = np.isfinite([one.low, one.high]).all()
    room = max(abs(one.low), abs(one.high)) if limited else np.pi
    reach = one.rows["target"].abs().max()
    si, other = ("m", "mm") if one.slides else ("rad", "deg")
    if reach > FAR * room:
        raise LogError(
            f"targets of {one.joint} reach {reach:.3g} {si}, the joint only {room:.3g} {si}: in "
            f"which unit are they? Say it with --unit, such as --unit {other}"
        )


def regressed(one: Rows) -> tuple[list[Term], list[str]]:
    """The terms of a joint, and what the table cannot tell; raises LogError for too few rows."""
    off, shown = one.rows["reading"] - one.rows["target"], f"has {len(one.rows)} rows at rest"
    columns = _columns(one.rows)
    return regress(one.joint, off.to_numpy(), columns, LEAST_RAD, FLOOR_RAD, shown)


def _columns(rows: pd.DataFrame) -> Iterator[tuple[str, np.ndarray | str]]:
    """What multiplies each term (T,), or why the table does not show it."""
    target = rows["target"].to_numpy()
    tau, side = rows["torque"].to_numpy() if "torque" in rows else None, _sides(target)
    yield "zero", np.ones(len(rows))
    if tau is None:
        yield "sag", "sag: no load is known; give --robot, or a column 'load [Nm]'"
    elif np.ptp(tau) < 1e-9:
        yield "sag", "sag: the load is the same in all rows; add rows with another"
    else:
        yield "sag", -tau
    both = {s for s in side if s} == {-1.0, 1.0}
    yield (
        "band",
        -side if both else "friction and play: all targets are reached from one side; add both",
    )
    yield "scale", target if np.ptp(target) > 1e-6 else "scale: there is one target; add others"
    if tau is not None and tau.min() < 0.0 < tau.max():
        yield "play", -np.sign(tau)
    elif tau is not None:
        pressed = "the load presses on one side" if tau.any() else "no load presses on it"
        yield "play", f"play: {pressed}; add rows with loads to both"


def _sides(target: np.ndarray) -> np.ndarray:
    """The side that a target was moved to (T,); 0: unknown."""
    moves = np.diff(target, prepend=target[:1])
    sides = pd.Series(np.where(np.abs(moves) > 1e-9, np.sign(moves), np.nan))
    return sides.ffill().fillna(0.0).to_numpy()
