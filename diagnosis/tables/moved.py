"""The torque that it takes to move a joint slowly to and fro: friction and weight.

    torque = offset + coulomb sign(v) + viscous v + (1 + weight) w(q)

with w what holds the links in the model. The drive may move it, or the bench.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from diagnosis.tables.joints import Rows
from diagnosis.tables.terms import Term, regress

BLOCK_S = 0.2
"""Rows are averaged over so long a time, longer than what makes them alike."""
SLOW = 0.1
"""Below so large a share of the fastest a joint rests or turns: its friction may be anything."""
FLOOR = 1e-3
"""No block is surer than so large a share of the largest torque."""


def friction(one: Rows) -> tuple[list[Term], list[str]]:
    """The terms of a joint, and what the rows cannot tell; raises LogError for too few."""
    blocks = _blocks(one.rows)
    speed, torque = blocks["speed"].to_numpy(), blocks["torque"].to_numpy()
    if (speed * torque).sum() < 0.0:  # the reaction was measured
        torque = -torque
    known = np.asarray(blocks.get("weight", 0.0))
    floor = FLOOR * float(np.abs(torque).max(initial=0.0))
    shown = f"moves in {len(blocks)} stretches of {BLOCK_S:g} s"
    return regress(one.joint, torque - known, _columns(blocks), floor, floor, shown)


def _blocks(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over `BLOCK_S` while it moves, and its speed."""
    some = rows.groupby((rows["time_s"] - rows["time_s"].iloc[0]) // BLOCK_S)
    moved = some.last() - some.first()
    blocks = some.mean().assign(speed=moved["position"] / moved["time_s"])
    blocks = blocks[np.isfinite(blocks["speed"])]
    return blocks[blocks["speed"].abs() > SLOW * blocks["speed"].abs().max()]


def _columns(blocks: pd.DataFrame) -> Iterator[tuple[str, np.ndarray | str]]:
    """What multiplies each term (T,), or why the rows do not show it."""
    speed = blocks["speed"].to_numpy()
    yield "offset", np.ones(len(speed))
    both = speed.min() < 0.0 < speed.max()
    yield (
        "coulomb",
        np.sign(speed) if both else "friction: it moves to one side alone; move it to and fro",
    )
    wide = np.ptp(np.abs(speed)) > 0.5 * np.abs(speed).max()
    yield "viscous", speed if wide else "viscous friction: it moves at one speed; add another"
    if "weight" not in blocks:
        yield "weight", "weight: give --robot"
    elif np.ptp(blocks["weight"]) < 1e-3:
        yield "weight", "weight: it is the same everywhere; move it farther"
    else:
        yield "weight", blocks["weight"].to_numpy()
