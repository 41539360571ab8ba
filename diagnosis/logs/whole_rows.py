"""Which rows of a table count where cells are empty: a command holds until the next one.

A row is a reading of all joints. Rows of commands alone, and empty cells of slow channels, need no
more than that; a few readings of a joint that lack are interpolated, and many are refused.
"""

from collections.abc import Iterator

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
EVEN, WHOLE, MOST = 0.2, 0.9, 0.5
"""Rows are even where so many of their steps are whole periods to this share of one, and where no
more of them lack."""


def without_empty_cells(samples: pd.DataFrame, notes: Notes) -> pd.DataFrame:
    """The samples of a log, in which joints may lack a few; raises LogError where they lack many.

    Columns that are empty throughout an episode stay so.
    """
    joints = [name for name in samples.columns if kind_of(str(name))]
    numbers = samples[joints].apply(pd.to_numeric, errors="coerce").astype(float)
    texts = numbers.isna() & samples[joints].notna()
    if np.isfinite(numbers).all(axis=None) or texts.any(axis=None) or "t_s" not in samples:
        return samples
    episode = samples["episode"] if "episode" in samples else pd.Series(0, index=samples.index)
    found = []
    for _, rows in samples.groupby(episode, sort=False, dropna=False):
        some = numbers.loc[rows.index].dropna(axis=1, how="all")
        if any("position" in name for name in some) and not np.isfinite(some).all(axis=None):
            time_s = pd.to_numeric(rows["t_s"], errors="coerce").to_numpy(float)
            filled, whole = whole_rows(some, time_s, np.zeros(len(rows), int), notes)
            rows = rows.assign(**filled)[whole]
        found.append(rows)
    return pd.concat(found, ignore_index=True)


def without_missing_rows(samples: pd.DataFrame, notes: Notes) -> pd.DataFrame:
    """The samples of joints alone, with rows that evenly made ones lack.

    Readings there are interpolated; so are commands that change from row to row, for what was sent
    in between was on its way, and to hold the last would look like a lost packet.
    """
    joints = [name for name in samples.columns if kind_of(str(name))]
    if set(samples.columns) - {*joints, "episode", "t_s", "protocol"}:
        return samples
    found, count = [], 0
    for _, rows in samples.groupby("episode", sort=False):
        time_s = rows["t_s"].to_numpy(float)
        periods = np.diff(time_s) / max(np.median(np.diff(time_s)), 1e-9)
        lacks = np.where(periods < NEAR, np.round(periods).astype(int) - 1, 0)
        even = np.mean(np.abs(periods - np.round(periods)) < EVEN) > WHOLE
        if not even or not 0 < lacks.clip(0).sum() < MOST * len(rows):
            found.append(rows)
            continue
        at = np.append(0, np.cumsum(lacks.clip(0) + 1))
        row = np.arange(at[-1] + 1)
        every, last = np.interp(row, at, time_s), np.searchsorted(at, row, side="right") - 1
        more = rows.iloc[last].reset_index(drop=True).assign(t_s=every)
        for name in joints:
            values = rows[name].to_numpy(float)
            if np.mean(np.diff(values) != 0.0) > 0.5:
                more[name] = np.interp(every, time_s, values)
        found.append(more)
        count += len(more) - len(rows)
    if not count:
        return samples
    notes.warnings.append(f"{in_words(count)} of even ones lack: there values are interpolated")
    return pd.concat(found, ignore_index=True)


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
    there, said = samples[read].notna(), notes.warnings
    rows = there.any(axis=1).to_numpy()
    apart = there.all(axis=1).sum() < TOGETHER * rows.sum()
    if apart and all(_is_regular(there[name].to_numpy(), time_s, part) for name in read):
        rows = there[there.sum().idxmin()].to_numpy()
        samples = samples.assign(**{name: _between(samples[name], time_s, part) for name in read})
        said.append("joints are read at different times: between readings they are interpolated")
    few = [n for n in read if 0 < (rows & samples[n].isna()).sum() <= FEW * rows.sum()]
    given = samples
    samples = samples.assign(**{name: _between(samples[name], time_s, part) for name in few})
    counts = rows & samples[read].notna().all(axis=1).to_numpy()
    if counts.sum() < (1.0 - FEW) * rows.sum():
        lacking = samples.loc[rows, read].isna().sum()
        raise LogError(
            f"{lacking.idxmax()} is empty in {lacking.max()} of {rows.sum()} rows; allowed: up to "
            f"{100 * FEW:.0f} %; log it in every row, or give the table without its columns"
        )
    said += _empty(given[read], counts, time_s, "there readings are interpolated")
    said += _empty(samples[read], rows, time_s, "these rows are left out")
    ahead_s = float(np.median(np.diff(time_s[counts]))) / 2 if counts.sum() > 1 else 0.0
    filled = samples.assign(**{name: _last(samples[name], time_s, part, ahead_s) for name in held})
    begun = filled[held].notna().all(axis=1).to_numpy()
    if early := int((counts & ~begun).sum()):
        said.append(f"{in_words(early)} before the first command left out")
    counts &= begun
    filled[slow] = filled.groupby(part)[slow].ffill()
    filled[slow] = filled.groupby(part)[slow].bfill()
    said += _empty(samples[[*held, *slow]], counts, time_s, "there the last value holds")
    return filled, counts


def _is_regular(there: np.ndarray, time_s: np.ndarray, part: np.ndarray) -> bool:
    """Whether a joint is read at steps that are alike; `there` (T,): where it is."""
    step = np.diff(time_s[there])[np.diff(part[there]) == 0]
    return bool(len(step)) and np.mean(np.abs(step / np.median(step) - 1.0) > REGULAR) <= FEW


def _stretches(part: np.ndarray) -> list[np.ndarray]:
    """The rows of each stretch."""
    return np.split(np.arange(len(part)), np.flatnonzero(np.diff(part)) + 1)


def _last(column: pd.Series, time_s: np.ndarray, part: np.ndarray, ahead_s: float) -> pd.Series:
    """The value of each row, or the one that acts for most of it: the last before its middle."""
    held = column.to_numpy(float, copy=True)
    for rows in _stretches(part):
        own = rows[np.isfinite(held[rows])]
        before = np.searchsorted(time_s[own], time_s[rows] + ahead_s, side="right")
        held[rows] = np.append(np.nan, held[own])[before]
    return column.fillna(pd.Series(held, index=column.index))


def _between(column: pd.Series, time_s: np.ndarray, part: np.ndarray) -> pd.Series:
    """Readings, interpolated where two of them are near each other in one stretch."""
    found = np.full(len(column), np.nan)
    for rows in _stretches(part):
        own = rows[column.iloc[rows].notna()]
        if len(own) < 2:
            continue
        at = time_s[own]
        after = np.clip(np.searchsorted(at, time_s[rows]), 1, len(at) - 1)
        near = at[after] - at[after - 1] <= NEAR * np.median(np.diff(at))
        between = np.interp(time_s[rows], at, column.iloc[own], left=np.nan, right=np.nan)
        found[rows] = np.where(near, between, np.nan)
    return column.fillna(pd.Series(found, index=column.index))


def _empty(some: pd.DataFrame, rows: np.ndarray, time_s: np.ndarray, then: str) -> Iterator[str]:
    """How many rows lack which columns, and where the first is."""
    lacks = some.isna() & rows[:, None]
    found = pd.DataFrame({"count": lacks.sum(), "first": lacks.to_numpy().argmax(axis=0)})
    for (count, first), names in found[found["count"] > 0].groupby(["count", "first"], sort=False):
        said = ", ".join(names.index)
        if count > FEW * rows.sum():
            own = in_words(some[names.index[0]].count())
            yield f"{said}: {own} of their own, each holds until the next"
        else:
            first_s = float(time_s[first] - time_s[rows][0])
            yield (
                f"{said}: empty in {count} of {rows.sum()} rows, the first at {first_s:.4g} s; "
                f"{then}"
            )
