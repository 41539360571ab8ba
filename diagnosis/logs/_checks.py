"""Check a log: its columns, times, rates, units, numbers and loads.

A log that cannot be used raises LogError; one that is unusual but usable gives a warning.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from diagnosis.logs._columns import KINDS, PULL, STICK, UNITS, channel_of, kind_of, name_of
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
STRONGEST_N = 1000.0
"""Largest plausible pull."""
INWARDS = 0.1
"""Share of the largest pull by which noise may push the stick into the hand."""
KEYS = ["episode", "t_s"]


def check(meta: LogMeta, samples: pd.DataFrame) -> tuple[LogMeta, pd.DataFrame, tuple[str, ...]]:
    """Meta with all episodes, the samples, and the warnings."""
    protocols = samples.get("protocol")
    samples = samples.drop(columns="protocol", errors="ignore")
    _check_names(samples)
    samples = _numbers(samples if "episode" in samples else samples.assign(episode=0))
    meta = _with_episodes(meta, samples["episode"], protocols)
    warnings: list[str] = []
    for number, part in samples.groupby("episode", sort=False):
        warnings += _gaps(f"episode {number}", part)
        _check_values(f"episode {number}", part)
    _check_channels(meta, samples)
    _check_touch_and_stick(samples)
    columns = [*KEYS, *(name for name in samples if name not in KEYS)]
    return meta, samples[columns].reset_index(drop=True), tuple(warnings)


def _refuse(bad: object, text: str) -> None:
    """Raise LogError with a text where something is bad."""
    if bad:
        raise LogError(text)


def _check_names(samples: pd.DataFrame) -> None:
    """Refuse unknown columns, and joints without a command and a position in the same unit."""
    for column in samples:
        if column not in KEYS:
            channel_of(str(column))
    _refuse(
        "t_s" not in samples, "samples have no column 't_s'; add the time of each sample in seconds"
    )
    joints = dict.fromkeys(pair[1] for column in samples if (pair := kind_of(str(column))))
    _refuse(
        not joints, "samples have no joint; add columns such as command_rad.J0 and position_rad.J0"
    )
    for joint in joints:
        linear = name_of("command", joint, linear=True) in samples
        for kind in KINDS:
            name, stray = name_of(kind, joint, linear), name_of(kind, joint, not linear)
            _refuse(
                kind in ("command", "position") and name not in samples,
                f"samples have no column '{name}'; every joint needs a command and a position, "
                "both in rad or both in m",
            )
            _refuse(
                stray in samples,
                f"'{stray}' does not fit joint {joint}, whose command is in "
                f"{'m' if linear else 'rad'}; rename it '{name}'",
            )


def _numbers(samples: pd.DataFrame) -> pd.DataFrame:
    """The samples with numeric columns; refuses text and fractional episodes."""
    _refuse(samples.empty, "samples have no rows; record the log again")
    samples = samples.copy()
    for column, given in samples.items():
        if str(column).startswith("touch."):
            cells = [c if isinstance(c, np.ndarray) else None for c in given]
            samples[column] = pd.Series(cells, index=samples.index, dtype=object)
            continue
        numbers = pd.to_numeric(given, errors="coerce")
        bad = (numbers.isna() & given.notna()).to_numpy()
        row = int(np.argmax(bad))
        _refuse(
            bad.any(),
            f"'{column}' is '{one_line(str(given.iloc[row]), 40)}' in sample {row}; allowed: "
            "numbers with a decimal point, or empty",
        )
        samples[column] = numbers.astype(float)
    whole = samples["episode"]
    _refuse(
        not ((whole == whole.round()) & (whole >= 0) & (whole < LARGEST)).all(),
        "'episode' must be a whole number from 0 in every sample; number the episodes",
    )
    return samples.astype({"episode": np.int64})


def _with_episodes(meta: LogMeta, numbers: pd.Series, protocols: pd.Series | None) -> LogMeta:
    """Meta with every episode of the samples, each in one piece and of one protocol.

    Samples have protocols of their own where `bench excite` wrote them.
    """
    found = numbers[numbers.diff() != 0].tolist()
    _refuse(
        len(found) > len(set(found)),
        "the samples of an episode are not in one piece; sort the rows by episode",
    )
    named = {e.episode: e for e in meta.episodes or (EpisodeMeta(episode=n) for n in found)}
    _refuse(
        sorted(e.episode for e in meta.episodes or named.values()) != sorted(found),
        f"log.yaml lists episodes {[e.episode for e in meta.episodes]}, samples hold {found}; "
        "make them equal",
    )
    own = {} if protocols is None else protocols.astype(str).groupby(numbers).unique()
    for number, names in own.items():
        one = named[number]
        said = {one_line(name, 40) or "free" for name in names} | {one.protocol} - {"free"}
        _refuse(
            len(said) > 1,
            f"episode {number} has the protocols {', '.join(sorted(said))}; name one of them, in "
            "the column 'protocol' or in log.yaml",
        )
        named[number] = one.model_copy(update={"protocol": said.pop()})
    return meta.model_copy(update={"episodes": tuple(named[n] for n in found)})


def _gaps(episode: str, part: pd.DataFrame) -> Iterator[str]:
    """Warn of gaps; refuse an episode that is short, or whose times repeat, go back or have a hole.

    Samples are counted from 0 in the file.
    """
    _refuse(
        len(part) < MIN_SAMPLES,
        f"{episode} has {len(part)} samples; needed: at least {MIN_SAMPLES}; "
        "record it longer or remove it",
    )
    t = part["t_s"].to_numpy()
    lost = ~np.isfinite(t)
    _refuse(lost.any(), f"'t_s' is not a number in sample {_row(part, lost)}; remove that row")
    step = np.diff(t)
    back = np.append(False, step <= 0)
    _refuse(
        back.any(),
        f"'t_s' {'goes back' if (step[step <= 0][:1] < 0).any() else 'repeats'} at sample "
        f"{_row(part, back)}; times must increase within an episode: remove the row, or give a "
        "new start a new episode number",
    )
    period = float(np.median(step))
    _refuse(
        period > SLOWEST_S,
        f"{episode} has {period:g} s between samples; allowed: up to {SLOWEST_S:g} s; "
        "is 't_s' in milliseconds? Divide it by 1000",
    )
    periods = np.append(0.0, step / period)
    longest, gaps = periods.max(), int((periods > GAP_PERIODS).sum())
    _refuse(
        longest > HOLE_PERIODS,
        f"{episode} has a hole of {longest:.0f} periods before sample "
        f"{_row(part, periods > HOLE_PERIODS)}; allowed: up to {HOLE_PERIODS:.0f}; give the rows "
        "after it a new episode number",
    )
    if gaps:
        yield f"{episode} has {gaps} gap{'s' * (gaps > 1)}; the longest has {longest:.1f} periods"


def _check_values(episode: str, part: pd.DataFrame) -> None:
    """Refuse NaN and what is too large, except where a column is empty in a whole episode."""
    for column, values in part.items():
        needed = str(column).startswith(("command_", "position_"))
        missing = values.isna().to_numpy()
        if not str(column).startswith("touch."):
            missing = ~(np.abs(values.to_numpy()) < (FARTHEST if needed else LARGEST))
        if missing.any() and (needed or not values.isna().all()):
            value = values.to_numpy()[missing][0]
            finite = isinstance(value, float) and np.isfinite(value)
            said = f"{value:g}" if finite else "not a finite number"
            raise LogError(
                f"'{column}' is {said} in sample {_row(part, missing)} of {episode}; fill it (a "
                "slower channel repeats its last value) or remove the row"
            )


def _check_channels(meta: LogMeta, samples: pd.DataFrame) -> None:
    """Refuse a channel that is not there, or is declared in another unit or at another rate."""
    columns = {name: channel_of(str(name)) for name in samples if name not in KEYS}
    there = ", ".join(dict.fromkeys(columns.values()))
    for name, channel in meta.channels.items():
        _refuse(
            name not in columns.values(),
            f"log.yaml declares '{name}', which samples lack; they hold: {there}",
        )
        _refuse(
            channel.unit not in UNITS[name],
            f"channel '{name}' is declared in {channel.unit}; allowed: "
            f"{' or '.join(UNITS[name])}; convert the numbers and correct the unit",
        )
    parts = samples.groupby("episode", sort=False)["t_s"]
    rows_hz = max(1.0 / float(np.median(np.diff(t))) for _, t in parts)
    for column, name in columns.items():
        rate = name in meta.channels and meta.channels[name].rate_hz
        if not rate or name in ("stick", "touch"):
            continue
        changes_hz = np.mean(np.diff(samples[column].dropna().to_numpy()) != 0) * rows_hz
        too_slow = rate < rows_hz / (1 + RATE_TOLERANCE) and changes_hz > 1.5 * rate
        _refuse(
            rate > rows_hz * (1 + RATE_TOLERANCE) or too_slow,
            f"channel '{name}' is declared at {rate:g} Hz, but t_s says {rows_hz:.4g} Hz; correct "
            "rate_hz or t_s (in seconds), or leave rate_hz out",
        )


def _check_touch_and_stick(samples: pd.DataFrame) -> None:
    """Refuse touch cells of different lengths or not finite, and poses that are not whole or unit.

    A quaternion has the length 1.
    """
    for column in (name for name in samples if str(name).startswith("touch.")):
        cells = [cell for cell in samples[column] if cell is not None]
        lengths = sorted({len(cell) for cell in cells})
        _refuse(
            len(lengths) > 1, f"'{column}' has {lengths} values; every sample needs the same number"
        )
        _refuse(
            cells and not np.isfinite(np.stack(cells)).all(),
            f"'{column}' holds a value that is not finite; write 0 for no contact",
        )
    missing = [name for name in STICK if name not in samples]
    if len(missing) == len(STICK):
        return
    said = ", ".join(missing)
    _refuse(missing, f"the stick's pose lacks {said}; give all seven columns or none")
    quat = samples[list(STICK[3:])].dropna().to_numpy()
    _refuse(
        (np.abs(np.linalg.norm(quat, axis=1) - 1) > 1e-2).any(),
        "stick_qw to stick_qz are not unit quaternions; normalise them, w first",
    )


def check_loads(meta: LogMeta, samples: pd.DataFrame) -> None:
    """Raise LogError for a push that nobody knows, or a pull that no hand holds against."""
    pull_n = samples.get(PULL, pd.Series(dtype=float)).to_numpy()
    low, high = np.nanmin(pull_n, initial=0.0), np.nanmax(pull_n, initial=0.0)
    _refuse(
        high > STRONGEST_N,
        f"'{PULL}' reaches {high:.4g} N; allowed: up to {STRONGEST_N:g} N; convert mN, grams "
        "or counts first",
    )
    _refuse(
        low < -INWARDS * high - 1e-9,
        f"'{PULL}' goes down to {low:.4g} N; forces towards the stick's lower end, out of the "
        "hand, must be positive; change the sign",
    )
    pushes = samples.filter(regex="^push_").notna().any(axis=1)
    for one in meta.episodes:
        _refuse(
            one.protocol == "push" and not pushes[samples["episode"] == one.episode].any(),
            f"episode {one.episode} is of protocol 'push' and has no channel 'push', so the push "
            "is unknown; log it, for example as 'push_nm.JOINT', or leave the episode out",
        )


def _row(part: pd.DataFrame, bad: np.ndarray) -> int:
    """Number of the first bad sample, counted from 0 in the file."""
    return int(part.index[int(np.argmax(bad))])
