"""Check a log: its columns, times, rates, units and numbers. Each check is one small function.

A log that cannot be used raises LogError; one that is unusual but usable gives a warning.
"""

import numpy as np
import pandas as pd

from diagnosis.logs._columns import KINDS, STICK, UNITS, channel_of, kind_of, name_of
from diagnosis.logs._meta import EpisodeMeta, LogError, LogMeta
from files.bounded import one_line

MIN_SAMPLES = 20
"""Shortest episode in samples."""
GAP_PERIODS, HOLE_PERIODS = 3.0, 20.0
"""A step longer than this is a gap (a warning), a much longer one is a hole, in median periods."""
LARGEST = 1e12
"""Numbers from here on count as infinite."""
FARTHEST = 1e6
"""Angles [rad] and ways [m] from here on are none of a joint's."""
RATE_TOLERANCE = 0.1
"""Largest relative difference between a declared rate and the rate of the rows."""
SLOWEST_S = 0.5
"""Longest median period [s]; with a longer one the times are in milliseconds, or it is no log of a
motion."""


def check(meta: LogMeta, samples: pd.DataFrame) -> tuple[LogMeta, pd.DataFrame, tuple[str, ...]]:
    """Meta with all episodes, the samples, and the warnings."""
    protocols = samples.get("protocol")
    samples = samples.drop(columns="protocol", errors="ignore")
    columns_are_known(samples)
    joints_are_complete(samples)
    samples = numbers_are_numbers(samples)
    samples = samples if "episode" in samples else samples.assign(episode=0)
    meta = episodes_are_named(meta, samples)
    if protocols is not None:
        meta = protocols_are_named(meta, samples["episode"], protocols)
    warnings: list[str] = []
    for number, part in samples.groupby("episode", sort=False):
        times_increase(int(str(number)), part, warnings)
        values_are_finite(int(str(number)), part)
    channels_fit(meta, samples)
    rates_fit(meta, samples)
    taxels_are_alike(samples)
    stick_is_whole(samples)
    first = [c for c in ("episode", "t_s") if c in samples]
    rest = [c for c in samples.columns if c not in first]
    return meta, samples[[*first, *rest]].reset_index(drop=True), tuple(warnings)


def columns_are_known(samples: pd.DataFrame) -> None:
    """Refuse columns with unknown names."""
    for column in samples.columns:
        if column not in ("episode", "t_s"):
            channel_of(str(column))
    if "t_s" not in samples:
        raise LogError("samples have no column 't_s'; add the time of each sample in seconds")


def joints_are_complete(samples: pd.DataFrame) -> None:
    """Refuse joints without a command and a position in the same unit."""
    pairs = [pair for column in samples.columns if (pair := kind_of(str(column)))]
    joints = tuple(dict.fromkeys(joint for _, joint in pairs))
    if not joints:
        raise LogError(
            "samples have no joint; add columns such as command_rad.J0 and position_rad.J0"
        )
    for joint in joints:
        linear = name_of("command", joint, linear=True) in samples
        for kind in ("command", "position"):
            if name_of(kind, joint, linear) not in samples:
                raise LogError(
                    f"samples have no column '{name_of(kind, joint, linear)}'; every joint needs "
                    "a command and a position, both in rad or both in m"
                )
        for kind in KINDS:
            stray = name_of(kind, joint, not linear)
            if stray in samples:
                raise LogError(
                    f"'{stray}' does not fit joint {joint}, whose command is in "
                    f"{'m' if linear else 'rad'}; rename it '{name_of(kind, joint, linear)}'"
                )


def numbers_are_numbers(samples: pd.DataFrame) -> pd.DataFrame:
    """The samples with numeric columns; refuses text and fractional episodes."""
    if samples.empty:
        raise LogError("samples have no rows; record the log again")
    samples = samples.copy()
    for column in samples.columns:
        if column.startswith("touch."):
            cells = [c if isinstance(c, np.ndarray) else None for c in samples[column]]
            samples[column] = pd.Series(cells, index=samples.index, dtype=object)
            continue
        numbers = pd.to_numeric(samples[column], errors="coerce")
        bad = numbers.isna() & samples[column].notna()
        if bad.any():
            row = int(np.argmax(bad))
            given = one_line(str(samples[column].iloc[row]), 40)
            raise LogError(
                f"'{column}' is '{given}' in sample {row}; allowed: numbers "
                "with a decimal point, or empty"
            )
        samples[column] = numbers.astype(float)
    if "episode" in samples:
        whole = samples["episode"]
        if not ((whole == whole.round()) & (whole >= 0) & (whole < LARGEST)).all():
            raise LogError(
                "'episode' must be a whole number from 0 in every sample; number the episodes"
            )
        samples["episode"] = whole.astype(np.int64)
    return samples


def episodes_are_named(meta: LogMeta, samples: pd.DataFrame) -> LogMeta:
    """Meta with every episode of the samples; refuses episodes that are not in one piece."""
    numbers = samples["episode"].to_numpy()
    starts = numbers[np.flatnonzero(np.diff(numbers, prepend=-1))]
    if len(starts) > len(set(starts)):
        raise LogError("the samples of an episode are not in one piece; sort the rows by episode")
    found = [int(n) for n in starts]
    if not meta.episodes:
        return meta.model_copy(update={"episodes": tuple(EpisodeMeta(episode=n) for n in found)})
    named = [e.episode for e in meta.episodes]
    if sorted(named) != sorted(found):
        raise LogError(f"log.yaml lists episodes {named}, samples hold {found}; make them equal")
    order = {e.episode: e for e in meta.episodes}
    return meta.model_copy(update={"episodes": tuple(order[n] for n in found)})


def protocols_are_named(meta: LogMeta, number: pd.Series, protocols: pd.Series) -> LogMeta:
    """Meta with the samples' own protocols, as `bench excite` writes them; refuses several."""
    found = []
    for one in meta.episodes:
        names = protocols[number == one.episode].astype(str).unique()
        said = {one_line(name, 40) or "free" for name in names} | {one.protocol} - {"free"}
        if len(said) > 1:
            raise LogError(
                f"episode {one.episode} has the protocols {', '.join(sorted(said))}; name one of "
                "them, in the column 'protocol' or in log.yaml"
            )
        found.append(one.model_copy(update={"protocol": said.pop()}))
    return meta.model_copy(update={"episodes": tuple(found)})


def times_increase(number: int, part: pd.DataFrame, warnings: list[str]) -> None:
    """Refuse an episode that is too short, or whose times repeat, decrease or leave a hole."""
    if len(part) < MIN_SAMPLES:
        raise LogError(
            f"episode {number} has {len(part)} samples; needed: at least {MIN_SAMPLES}; "
            "record it longer or remove it"
        )
    t = part["t_s"].to_numpy()
    if not np.isfinite(t).all():
        raise LogError(
            f"'t_s' is not a number in sample {_row(part, ~np.isfinite(t))}; remove that row"
        )
    step = np.diff(t)
    if (step <= 0).any():
        what = "repeats" if step[np.argmax(step <= 0)] == 0 else "goes back"
        raise LogError(
            f"'t_s' {what} at sample {_row(part, np.append(False, step <= 0))}; times must "
            "increase within an episode: remove the row, or give a new start a new episode number"
        )
    period = float(np.median(step))
    if period > SLOWEST_S:
        raise LogError(
            f"episode {number} has {period:g} s between samples; allowed: up to {SLOWEST_S:g} s; "
            "is 't_s' in milliseconds? Divide it by 1000"
        )
    _refuse_holes(number, part, step / period, warnings)


def _refuse_holes(number: int, part: pd.DataFrame, periods: np.ndarray, warnings: list) -> None:
    if periods.max() > HOLE_PERIODS:
        row = _row(part, np.append(False, periods > HOLE_PERIODS))
        raise LogError(
            f"episode {number} has a hole of {periods.max():.0f} periods before sample {row}; "
            f"allowed: up to {HOLE_PERIODS:.0f}; give the rows after it a new episode number"
        )
    gaps = int((periods > GAP_PERIODS).sum())
    if gaps:
        warnings.append(
            f"episode {number} has {gaps} gaps; the longest has {periods.max():.1f} periods"
        )


def values_are_finite(number: int, part: pd.DataFrame) -> None:
    """Refuse NaN and what is too large, except where a column is empty in a whole episode."""
    for column in part.columns:
        needed = column.startswith(("command_", "position_"))
        if column.startswith("touch."):
            missing = part[column].isna().to_numpy()
        else:
            missing = ~(np.abs(part[column].to_numpy()) < (FARTHEST if needed else LARGEST))
        if missing.any() and (needed or not part[column].isna().all()):
            value = part[column].to_numpy()[missing][0]
            finite = isinstance(value, float) and np.isfinite(value)
            said = f"{value:g}" if finite else "not a finite number"
            raise LogError(
                f"'{column}' is {said} in sample {_row(part, missing)} of episode "
                f"{number}; fill it (a slower channel repeats its last value) or remove the row"
            )


def channels_fit(meta: LogMeta, samples: pd.DataFrame) -> None:
    """Refuse a declared channel that is not there, or a unit that does not fit its name."""
    found = dict.fromkeys(channel_of(c) for c in samples.columns if c not in ("episode", "t_s"))
    for name, channel in meta.channels.items():
        if name not in found:
            raise LogError(
                f"log.yaml declares '{name}', which samples lack; they hold: {', '.join(found)}"
            )
        if channel.unit not in UNITS[name]:
            raise LogError(
                f"channel '{name}' is declared in {channel.unit}; allowed: "
                f"{' or '.join(UNITS[name])}; convert the numbers and correct the unit"
            )


def rates_fit(meta: LogMeta, samples: pd.DataFrame) -> None:
    """Refuse a declared rate above that of the rows, or one that values change faster than."""
    rows = _rate_hz(samples)
    for column in samples.columns:
        if column in ("episode", "t_s", *STICK) or column.startswith("touch."):
            continue
        declared = meta.channels.get(channel_of(column))
        rate = (declared and declared.rate_hz) or rows
        changes = np.mean(np.diff(samples[column].dropna().to_numpy()) != 0)
        too_slow = rate < rows / (1 + RATE_TOLERANCE) and changes * rows > 1.5 * rate
        if rate > rows * (1 + RATE_TOLERANCE) or too_slow:
            raise LogError(
                f"channel '{channel_of(column)}' is declared at {rate:g} Hz, but t_s says "
                f"{rows:.4g} Hz; correct rate_hz or t_s (in seconds), or leave rate_hz out"
            )


def taxels_are_alike(samples: pd.DataFrame) -> None:
    """Refuse touch cells of different lengths or with values that are not finite."""
    for column in samples.columns:
        if not column.startswith("touch."):
            continue
        cells = [cell for cell in samples[column] if cell is not None]
        lengths = {len(cell) for cell in cells}
        if len(lengths) > 1:
            raise LogError(
                f"'{column}' has {sorted(lengths)} values; every sample needs the same number"
            )
        if cells and not np.isfinite(np.stack(cells)).all():
            raise LogError(f"'{column}' holds a value that is not finite; write 0 for no contact")


def stick_is_whole(samples: pd.DataFrame) -> None:
    """Refuse a stick pose with missing columns or with quaternions that are not of length 1."""
    there = [name for name in STICK if name in samples]
    if not there:
        return
    if len(there) < len(STICK):
        missing = ", ".join(name for name in STICK if name not in there)
        raise LogError(f"the stick's pose lacks {missing}; give all seven columns or none")
    quat = samples[list(STICK[3:])].dropna().to_numpy()
    if len(quat) and np.abs(np.linalg.norm(quat, axis=1) - 1).max() > 1e-2:
        raise LogError("stick_qw to stick_qz are not unit quaternions; normalise them, w first")


def _rate_hz(samples: pd.DataFrame) -> float:
    """Rows per second in the fastest episode."""
    parts = samples.groupby("episode", sort=False)["t_s"]
    return max(1.0 / float(np.median(np.diff(t))) for _, t in parts)


def _row(part: pd.DataFrame, bad: np.ndarray) -> int:
    """Number of the first bad sample, counted from 0 in the file."""
    return int(part.index[int(np.argmax(bad))])
