"""The clock of a table: its time stamps in seconds, and the episodes that they show."""

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from diagnosis.logs._checks import HOLE_PERIODS, MIN_SAMPLES, SLOWEST_S
from diagnosis.logs._meta import LogError
from diagnosis.logs.roles import TIMES, episode_column, time_column, words

COARSE = 0.02
"""So large a share of repeated stamps means that they are coarse, a smaller one that rows are
doubled."""
UNTIMED = 0.1
"""Largest share of rows without a time."""


@dataclass
class Notes:
    """What is understood of a user's tables, and what is odd, a line each: readers add to it."""

    said: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Timed:
    """The rows of a table that have a time, in its order."""

    frame: pd.DataFrame
    """Indexed from 0."""
    column: str
    unit: str
    """A key of `TIMES`, or 'dates'."""
    time_s: np.ndarray
    """In seconds, shape (T,)."""
    part: np.ndarray
    """Number of the stretch of each row, shape (T,): a clock that starts again, or another episode,
    begins one."""


def rows(count: int) -> str:
    """So many rows, in words."""
    return f"{count} row{'s' * (int(count) != 1)}"


def timed(frame: pd.DataFrame, notes: Notes) -> Timed:
    """The rows with their times; raises LogError where there are none."""
    name = time_column(list(frame.columns))
    if name is None:
        raise LogError(
            f"no column is the time; the table has {', '.join(map(str, frame.columns))}; name one "
            "'time', in seconds"
        )
    stamps, unit = _stamps(frame[name], name)
    there = np.isfinite(stamps)
    lost = int((~there).sum())
    if lost > UNTIMED * len(stamps):
        raise LogError(
            f"the time '{name}' is no number in {lost} of {len(stamps)} rows; remove those rows"
        )
    if lost:
        notes.warnings.append(f"{rows(lost)} without a time left out")
    frame, time_s = frame[there].reset_index(drop=True), stamps[there]
    given = episode_column(list(frame.columns))
    number = pd.factorize(frame[given])[0] if given else np.zeros(len(frame), int)
    again = np.diff(time_s) < -MIN_SAMPLES * _median(time_s)
    part = np.append(0, np.cumsum(again | (np.diff(number) != 0)))
    order = np.lexsort((time_s, part))
    if moved := int((np.diff(time_s) < 0).sum() - (np.diff(time_s[order]) < 0).sum()):
        notes.warnings.append(f"{rows(moved)} earlier than the row before: put in order")
    frame = frame.iloc[order].reset_index(drop=True)
    return Timed(frame=frame, column=name, unit=unit, time_s=time_s[order], part=part)


def _stamps(column: pd.Series, name: str) -> tuple[np.ndarray, str]:
    """Time stamps [s], NaN where a row has none, and their unit; dates and times of day, too.

    The unit is that of the name, or the one that puts rows a plausible time apart.
    """
    values = pd.to_numeric(column, errors="coerce").to_numpy(float)
    if not np.isfinite(values).any():
        texts = column.astype(str)
        dates = pd.to_datetime(texts, errors="coerce", format="ISO8601", utc=True)
        found = dates if dates.notna().any() else pd.to_timedelta(texts, errors="coerce")
        return (found - found.min()).dt.total_seconds().to_numpy(float), "dates"
    step = _median(values[np.isfinite(values)])
    named = [u for u in words(name) if u in TIMES and u != "s"]
    plausible = [u for u in ("s", "ms", "us", "ns") if step / TIMES[u] <= SLOWEST_S]
    unit = [*named, *plausible, "ns"][0]
    return values / TIMES[unit], unit


def _median(times: np.ndarray) -> float:
    """The median step of a clock."""
    forward = np.diff(times)[np.diff(times) > 0]
    return float(np.median(forward)) if len(forward) else 1.0


def episodes(clock: Timed, whole: np.ndarray, notes: Notes) -> tuple[pd.DataFrame, np.ndarray]:
    """Episodes and times of the `whole` rows (T,), and which of the clock's rows count (T,).

    A stretch that is too short for an episode does not count, unless all are.
    """
    at, part = np.flatnonzero(whole), clock.part[whole]
    step = np.diff(clock.time_s[at])
    holes = step > HOLE_PERIODS * _median(clock.time_s[at])
    number = np.append(0, np.cumsum((np.diff(part) != 0) | holes))
    same = np.append(False, (step == 0) & (np.diff(number) == 0))
    counts = np.full(len(number), True)
    if 0 < same.sum() <= COARSE * len(same):
        counts &= ~same
        notes.warnings.append(f"{rows(same.sum())} with the time of the row before left out")
    size = np.bincount(number[counts], minlength=number[-1] + 1)
    if size.max() >= MIN_SAMPLES > size[size > 0].min():
        short = size[number] < MIN_SAMPLES
        counts &= ~short
        notes.warnings.append(
            f"{rows(short.sum())} left out, in stretches of fewer than {MIN_SAMPLES} rows"
        )
    at, number = at[counts], np.unique(number[counts], return_inverse=True)[1]
    samples = pd.DataFrame({"episode": number, "t_s": clock.time_s[at]})
    by_number = samples.groupby("episode")["t_s"]
    first, last = by_number.transform("first"), by_number.transform("last")
    samples["t_s"] -= first
    repeats = samples["t_s"].diff().le(0) & samples["episode"].diff().eq(0)
    if repeats.any():
        coarse = by_number.transform("size").where(repeats.groupby(number).transform("any"))
        evenly = (last - first) * by_number.cumcount() / (coarse - 1)
        samples["t_s"] = evenly.fillna(samples["t_s"])
        notes.warnings.append(
            f"{repeats.sum()} times repeat, so rows are spread evenly over each episode"
        )
    if "protocol" in clock.frame:
        samples["protocol"] = clock.frame["protocol"].iloc[at].astype(str).to_numpy()
    lasts_s = float(samples.groupby("episode")["t_s"].last().sum())
    count, rate = int(number.max()) + 1, 1.0 / _median(samples["t_s"].to_numpy())
    notes.said.append(f"t_s is '{clock.column}' in {clock.unit}")
    notes.said.append(f"{count} episode{'s' * (count > 1)}, {lasts_s:.3g} s at {rate:.4g} Hz")
    return samples, at
