"""Which rows of a table count where cells are empty: a command holds until the next one.

A row is a reading of all joints. Rows of commands alone, and empty cells of slow channels, need no
more than that; a few readings of a joint that lack are interpolated, and many are refused.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd

from diagnosis.logs._columns import kind_of
from diagnosis.logs._meta import LogError
from diagnosis.logs.stamps import Notes
from diagnosis.logs.stamps import rows as in_words

HELD = ("command", "reference", "feedforward", "push")
"""Kinds that hold until their next value."""
FEW = 0.1
"""Largest share of readings that may be missing."""
TOGETHER, REGULAR = 0.6, 0.5
"""Joints are read by clocks of their own where so few of the rows have them all, and where the
steps of each are within this share of their median."""
NEAR = 3.5
"""Readings so many median steps apart, or fewer, say what was between them."""


def whole_rows(
    samples: pd.DataFrame, time_s: np.ndarray, part: np.ndarray, notes: Notes
) -> tuple[pd.DataFrame, np.ndarray]:
    """The samples without empty cells, and which rows count (T,); raises LogError.

    `part`: number of the stretch of each row.
    """
    samples = samples.replace([np.inf, -np.inf], np.nan)
    kinds = {name: (kind_of(str(name)) or ("", ""))[0] for name in samples.columns}
    read = [name for name, kind in kinds.items() if kind == "position"]
    held = [name for name, kind in kinds.items() if kind in HELD]
    slow = [name for name in kinds if name not in (*read, *held)]
    rows, said = samples[read].notna().any(axis=1).to_numpy(), notes.warnings
    there = samples[read].notna().to_numpy()
    if there.all(axis=1).sum() < TOGETHER * rows.sum() and _regular(there, time_s, part):
        samples, rows = _by_the_slowest(samples, read, time_s, part)
        said.append("joints are read at different times: between readings they are interpolated")
    given, samples = samples, _interpolated(samples, read, rows, time_s, part)
    counts = rows & samples[read].notna().all(axis=1).to_numpy()
    if counts.sum() < (1.0 - FEW) * rows.sum():
        lacking = samples.loc[rows, read].isna().sum()
        raise LogError(
            f"{lacking.idxmax()} is empty in {lacking.max()} of {rows.sum()} rows; allowed: up to "
            f"{100 * FEW:.0f} %; log it in every row, or give the table without its columns"
        )
    said += _empty(given[read], counts, time_s, "there readings are interpolated")
    said += _empty(samples[read], rows, time_s, "these rows are left out")
    filled = samples.copy()
    ahead_s = float(np.median(np.diff(time_s[counts]))) / 2 if counts.sum() > 1 else 0.0
    for name in held:
        filled[name] = _last(samples[name].to_numpy(float), time_s, part, ahead_s)
    begun = filled[held].notna().all(axis=1).to_numpy()
    if early := int((counts & ~begun).sum()):
        said.append(f"{in_words(early)} before the first command left out")
    counts &= begun
    filled[slow] = filled.groupby(part)[slow].ffill()
    filled[slow] = filled.groupby(part)[slow].bfill()
    said += _empty(samples[[*held, *slow]], counts, time_s, "there the last value holds")
    return filled, counts


def _regular(there: np.ndarray, time_s: np.ndarray, part: np.ndarray) -> bool:
    """Whether each joint is read at steps that are alike; `there` (T, J): where it is."""
    for mine in there.T:
        step = np.diff(time_s[mine])[np.diff(part[mine]) == 0]
        if not len(step) or np.mean(np.abs(step / np.median(step) - 1.0) > REGULAR) > FEW:
            return False
    return True


def _interpolated(
    samples: pd.DataFrame,
    read: Sequence[str],
    rows: np.ndarray,
    time_s: np.ndarray,
    part: np.ndarray,
) -> pd.DataFrame:
    """Readings of joints that lack a few, with those that their neighbours are near."""
    found = {}
    for name in read:
        mine = samples[name].notna().to_numpy()
        if 0 < (rows & ~mine).sum() <= FEW * rows.sum():
            found[name] = _between(samples[name].to_numpy(float), mine, time_s, part)
    return samples.assign(**found)


def _by_the_slowest(
    samples: pd.DataFrame, read: Sequence[str], time_s: np.ndarray, part: np.ndarray
) -> tuple[pd.DataFrame, np.ndarray]:
    """Readings at the times of the joint that is read least, and which rows these are."""
    there = {name: samples[name].notna().to_numpy() for name in read}
    found = {
        name: _between(samples[name].to_numpy(float), mine, time_s, part)
        for name, mine in there.items()
    }
    return samples.assign(**found), there[min(read, key=lambda name: int(there[name].sum()))]


def _last(values: np.ndarray, time_s: np.ndarray, part: np.ndarray, ahead_s: float) -> np.ndarray:
    """The value of each row, or the one that acts for most of it: the last before its middle."""
    found, there = values.copy(), np.isfinite(values)
    for number in np.unique(part):
        rows = np.flatnonzero(part == number)
        own = rows[there[rows]]
        last = np.searchsorted(time_s[own], time_s[rows] + ahead_s, side="right") - 1
        held = np.where(last >= 0, values[own[np.maximum(last, 0)]], np.nan) if len(own) else np.nan
        found[rows] = np.where(there[rows], values[rows], held)
    return found


def _between(
    values: np.ndarray, mine: np.ndarray, time_s: np.ndarray, part: np.ndarray
) -> np.ndarray:
    """Readings, interpolated where two of them are near each other in one stretch."""
    found = values.copy()
    for number in np.unique(part):
        rows = part == number
        own = rows & mine
        if own.sum() < 2:
            continue
        at = time_s[own]
        after = np.clip(np.searchsorted(at, time_s[rows]), 1, len(at) - 1)
        inside = (time_s[rows] >= at[0]) & (time_s[rows] <= at[-1])
        near = at[after] - at[after - 1] <= NEAR * np.median(np.diff(at))
        between = np.interp(time_s[rows], at, values[own])
        known = np.where(inside & near, between, np.nan)
        found[rows] = np.where(mine[rows], values[rows], known)
    return found


def _empty(some: pd.DataFrame, rows: np.ndarray, time_s: np.ndarray, then: str) -> Iterator[str]:
    """How many rows lack which columns, and where the first is."""
    found: dict[tuple[int, float], list[str]] = {}
    for name in some.columns:
        lacks = rows & some[name].isna().to_numpy()
        if lacks.any():
            first_s = float(time_s[lacks][0] - time_s[rows][0])
            found.setdefault((int(lacks.sum()), first_s), []).append(str(name))
    for (count, first_s), names in found.items():
        if count > FEW * rows.sum():
            own = in_words(some[names[0]].count())
            yield f"{', '.join(names)}: {own} of their own, each holds until the next"
        else:
            yield (
                f"{', '.join(names)}: empty in {count} of {rows.sum()} rows, the first at "
                f"{first_s:.4g} s; {then}"
            )
