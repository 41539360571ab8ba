"""One table of a recording that lies in several files, or in a row per sample and joint.

Each file, or each label such as a joint's name, has rows and a clock of its own. They are put on
one clock: a row for every time at which any of them has one, with empty cells for the others.
"""

from collections.abc import Iterator, Mapping, Sequence
from os.path import commonprefix
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._meta import LogError
from diagnosis.logs.foreign import read_table
from diagnosis.logs.roles import SAYING, episode_column, joint_named, roles, words
from diagnosis.logs.ros import is_bag
from diagnosis.logs.stamps import Notes, Timed, timed

ENDS = (".csv", ".parquet", ".tsv", ".txt", ".dat")
"""Ends of the names of tables in a folder: those with the first of these that there are."""
MOST_FILES, NAMED, MOST_NAMED = 500, 4, 12
SAME_S = 1e-7
"""Times as near as this are one."""
LABELS = {"joint", "name", "motor", "servo", "axis", "actuator", "id", "dof", "signal", "channel"}
LABELS |= {"variable", "field", "topic", "key", "joints", "names", "quantity", "kind"}
NUMBERED = {"index", "number", "no", "nr"}
PROTOCOL = "protocol"
BOTH = {"command", "position", "bare", "error"}
"""Kinds of which two say what was asked of a joint, and what it did."""


def read_tables(paths: Sequence[Path], joints: Sequence[str], notes: Notes) -> pd.DataFrame:
    """The table in files, or in all files of folders, for a model's joints; raises LogError."""
    files = [file for path in paths for file in _files(path)]
    read = [(file, *read_table(file)) for file in files]
    notes.said += [
        f"{file.name}: {form}, {len(frame)} rows, {len(frame.columns)} columns"
        for file, frame, form in read[:NAMED]
    ]
    if len(read) > NAMED:
        notes.said.append(f"and {len(read) - NAMED} more files")
    parts = zip(_stems(files), (frame for _, frame, _ in read), strict=True)
    frames = {name: _wide(frame, joints, notes) for name, frame in parts}
    if len(frames) == 1:
        return frames.popitem()[1]
    whole = {_complete(frame, joints) for frame in frames.values()}
    if len(whole) == 1 and whole != {frozenset()}:
        notes.said.append("each file is a recording of its own")
        return _after_each_other(list(frames.values()))
    notes.said.append("the files are put together by their times")
    return _on_one_clock(frames, notes)


def _files(path: Path) -> list[Path]:
    """A file; the tables of a folder, or those that a name with * means; raises LogError."""
    if (path / "meta" / "info.json").is_file():  # a data set of LeRobot
        found = sorted(path.glob("data/**/*.parquet"))
    elif path.is_dir() and not is_bag(path):
        every = ([*path.glob(f"*{end}"), *path.glob(f"*{end.upper()}")] for end in ENDS)
        found = sorted(next(filter(None, every), []))
    elif not path.exists() and any(c in path.name for c in "*?["):
        found = sorted(path.parent.glob(path.name))
    else:
        return [path]
    if not 0 < len(found) <= MOST_FILES:
        raise LogError(
            f"{path} has {len(found)} tables; allowed: 1 to {MOST_FILES} files, whose names end in "
            f"{', '.join(ENDS)}"
        )
    return found


def _stems(files: Sequence[Path]) -> list[str]:
    """What the names of files say apart from the words that all begin with; raises LogError."""
    have = [words(file.stem) for file in files]
    same = len(commonprefix(have)) if len(files) > 1 else 0
    stems = [" ".join(w[same:]) or file.stem for w, file in zip(have, files, strict=True)]
    if len(set(stems)) < len(stems):
        stems = [file.stem for file in files]
    if len(set(stems)) < len(stems):
        raise LogError(f"two tables are called {next(s for s in stems if stems.count(s) > 1)}")
    return stems


def _complete(frame: pd.DataFrame, joints: Sequence[str]) -> frozenset[str]:
    """Joints of which a table has command and position."""
    kinds: dict[str, set[str]] = {}
    for role in roles(list(frame.columns), joints):
        kinds.setdefault(role.joint, set()).add(role.kind)
    return frozenset(j for j, have in kinds.items() if len(have & BOTH) > 1)


def _after_each_other(frames: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Recordings as one table, in which each begins an episode."""
    found = []
    for number, frame in enumerate(frames):
        given = episode_column(list(frame.columns))
        own = frame[given].astype(str) if given else ""
        found.append(frame.drop(columns=given or []).assign(episode=f"{number} " + own))
    return pd.concat(found, ignore_index=True)


def _wide(frame: pd.DataFrame, joints: Sequence[str], notes: Notes) -> pd.DataFrame:
    """A table with a column per joint and kind, where it has a row per sample and joint."""
    names = list(_labels(frame, joints))
    if not names:
        return frame
    labels = frame[names].map(_text).agg(" ".join, axis=1)
    rest = frame.drop(columns=names)
    parts = {label: rest[labels == label] for label in labels.unique()}
    said = f"a row per sample and {' and '.join(names)}: {', '.join(parts)}"
    if said not in notes.said:
        notes.said.append(said)
    return _on_one_clock(parts, notes)


def _labels(frame: pd.DataFrame, joints: Sequence[str]) -> Iterator[str]:
    """Columns that say of which joint a row is, and of which of its kinds or in which unit.

    Without joints, as where there is no model, every label names one. Raises LogError where they
    name other joints than the model's.
    """
    columns = list(frame.columns)
    if any(joint_named(name, joints) for name in columns):
        return
    values = {name: frame[name].dropna().unique() for name in columns}
    few = {name: some for name, some in values.items() if 0 < 2 * len(some) <= len(frame)}
    texts = {name: [*map(_text, some)] for name, some in few.items()}
    numbers = [n for n in few if pd.api.types.is_numeric_dtype(frame[n]) and _is_label(n)]
    by_name = [n for n in texts if n in numbers or frame[n].dtype.kind not in "ifub"]
    if joints:
        found = [n for n in by_name if any(joint_named(text, joints) for text in texts[n])]
        found = found or [n for n in numbers if len(texts[n]) == len(joints)]
    else:
        several = (n for n in by_name if _is_label(n) and len(texts[n]) > 1)
        found = [n for n in several if not _is_saying(texts[n])]
    strange = next((n for n in by_name if _is_label(n) and not _is_saying(texts[n])), None)
    if strange and joints and not found and not roles(columns, joints):
        raise LogError(
            f"the column '{strange}' names {', '.join(sorted(texts[strange])[:MOST_NAMED])}, and "
            f"the model has {', '.join(joints)}; give both the same names"
        )
    yield from found[:1]
    for name in by_name if found else ():
        if name not in (*found, *numbers, PROTOCOL) and _is_saying(texts[name]):
            yield name


def _is_saying(texts: Sequence[str]) -> bool:
    """Whether labels say kinds and units alone."""
    return all(set(words(text)) <= SAYING for text in texts)


def _is_label(name: str) -> bool:
    have = set(words(name))
    return bool(have & LABELS) and have <= LABELS | NUMBERED


def _text(value: object) -> str:
    """A label as text: whole numbers without a point."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _on_one_clock(parts: Mapping[str, pd.DataFrame], notes: Notes) -> pd.DataFrame:
    """Tables side by side, by their times; the name of each stands before its columns'.

    Raises LogError where they have no times in common.
    """
    own = {name: Notes() for name in parts}
    clocks = {name: timed(frame, own[name]) for name, frame in parts.items()}
    notes.warnings += [f"{name}: {text}" for name, one in own.items() for text in one.warnings]
    stretches = {name: int(clock.part.max()) + 1 for name, clock in clocks.items()}
    if len(set(stretches.values())) > 1:
        said = ", ".join(f"{name} {count}" for name, count in stretches.items())
        raise LogError(f"clocks start again in some tables and not in others: {said}; split them")
    start_s = min(float(clock.time_s.min()) for clock in clocks.values())
    ends = {n: (c.time_s.min() - start_s, c.time_s.max() - start_s) for n, c in clocks.items()}
    if max(a for a, _ in ends.values()) >= min(b for _, b in ends.values()):
        said = ", ".join(f"{name} {a:.4g} to {b:.4g} s" for name, (a, b) in ends.items())
        raise LogError(f"the tables have no time in common: {said}")
    keyed = [_keyed(name, clock, start_s) for name, clock in clocks.items()]
    protocols = [one.pop(PROTOCOL) for one in keyed if PROTOCOL in one]
    frame = pd.concat(keyed, axis=1, join="outer").sort_index()
    if protocols:
        frame[PROTOCOL] = protocols[0].reindex(frame.index).ffill().bfill()
    return frame.reset_index().rename(columns={"part": "episode"}).drop(columns="same")


def _keyed(name: str, clock: Timed, start_s: float) -> pd.DataFrame:
    """A table's values by stretch, time, and number among the rows of that time."""
    time_s = np.round((clock.time_s - start_s) / SAME_S) * SAME_S
    keys = pd.DataFrame({"part": clock.part, "time_s": time_s})
    keys["same"] = keys.groupby(["part", "time_s"]).cumcount()
    no_values = {clock.column, episode_column(list(clock.frame.columns))}
    values = clock.frame[[n for n in clock.frame if n not in no_values]]
    values = values.rename(columns=lambda n: n if n == PROTOCOL else f"{name}.{n}")
    return values.set_index(pd.MultiIndex.from_frame(keys))
