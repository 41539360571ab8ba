"""Recordings of ROS 2 (rosbag2 folders, `.db3`, `.mcap`) and ROS 1 (`.bag`) as a table.

Readings come from a JointState, commands from a trajectory, a second JointState, an array of
numbers, or from a controller's state, which holds both. A row is a reading; a command holds from
the nearest one on, until the next.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from diagnosis.logs._meta import LogError
from diagnosis.logs.roles import COMMAND, words

SUFFIXES = (".mcap", ".db3", ".bag")
STATE, TRAJECTORY = "JointState", "JointTrajectory"
CONTROLLER = ("JointTrajectoryControllerState", "JointControllerState")
ARRAY = "Float64MultiArray"
PAIRS = (("reference", "feedback"), ("desired", "actual"))
"""Fields of a controller's state, in two generations of ROS."""
Series = dict[str, list[tuple[float, float]]]
"""Times [s] and values by column."""


def is_bag(path: Path) -> bool:
    """Whether a path is a recording of ROS."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def read_bag(path: Path) -> tuple[pd.DataFrame, str]:
    """The table and what it was made of, in words; raises LogError."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(
            f"{path} is a recording of ROS; to read it, run: pip install rosbags"
        ) from None
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            chosen = _chosen({c.topic: c.msgtype.split("/")[-1] for c in reader.connections})
            used = [c for c in reader.connections if c.topic in chosen]
            rows = [
                (chosen[c.topic], stamp * 1e-9, reader.deserialize(raw, c.msgtype))
                for c, stamp, raw in reader.messages(connections=used)
            ]
            frame = _table(rows)
    except (AnyReaderError, OSError, ValueError, KeyError, AttributeError) as error:
        raise LogError(f"{path} cannot be read: {' '.join(str(error).split())[:200]}") from None
    said = ", ".join(f"{role} of {topic}" for topic, role in chosen.items())
    return frame, f"a recording of ROS, {said}"


def _chosen(topics: Mapping[str, str]) -> dict[str, str]:
    """What is used of each topic: `state`, `command` or `both`; raises LogError."""
    both = [topic for topic, kind in topics.items() if kind in CONTROLLER]
    if both:
        return {both[0]: "both"}
    asked = {
        topic: "command"
        for topic, kind in topics.items()
        if kind == TRAJECTORY or (kind in (STATE, ARRAY) and COMMAND & _words(topic))
    }
    states = [topic for topic, kind in topics.items() if kind == STATE and topic not in asked]
    if len(states) == 1 and len(asked) == 1:
        return {states[0]: "state", **asked}
    there = ", ".join(f"{topic} ({kind})" for topic, kind in topics.items())
    raise LogError(
        f"one JointState and one topic of commands are needed, or a controller's state; the "
        f"recording has {there or 'none'}: record the two, or filter the others out"
    )


def _words(topic: str) -> set[str]:
    """The words of a topic, without plurals."""
    return {word.removesuffix("s") for word in words(topic)} | set(words(topic))


def _table(rows: Sequence[tuple[str, float, Any]]) -> pd.DataFrame:
    """A row per reading, with the last command that is not nearer to the next; raises LogError.

    A trajectory moves linearly from where its message finds it to each of its points.
    """
    read, asked = Series(), Series()
    order = next((_names(message) for role, _, message in rows if role != "command"), [])
    ramps = any(hasattr(message, "points") for _, _, message in rows)
    for role, bag_s, message in rows:
        when_s = _stamp(message) or bag_s
        if role in ("state", "both"):
            said = message if role == "state" else _part(message, 1)
            _note(read, said, _names(message), when_s)
        if role == "both":
            _note(asked, _part(message, 0), _names(message), when_s)
        elif role == "command":
            for series in asked.values() if ramps else ():
                if series[-1][0] < when_s:
                    series.append((when_s, series[-1][1]))
            for after_s, point, names in _targets(message, order):
                _note(asked, point, names, when_s + after_s)
    positions = [name for name in order if f"{name}.position" in read]
    if not positions or not asked:
        raise LogError(f"it has no {'positions' if not positions else 'commands'} of joints")
    time_s = np.array([t for t, _ in read[f"{positions[0]}.position"]])
    found = {"time": time_s}
    for column, series in read.items():
        at, value = np.array(series).T
        found[column] = np.interp(time_s, at, value)
    first_s, half_s = float(time_s[0]), float(np.median(np.diff(time_s))) / 2
    for column, series in asked.items():
        at, value = np.array(sorted(series, key=lambda pair: pair[0])).T
        name = column.replace(".position", ".command").replace(".velocity", ".velocity_command")
        name = name.replace(".effort", ".effort_ff")
        last = np.maximum(np.searchsorted(at, time_s + half_s) - 1, 0)
        found[name] = np.interp(time_s, at, value) if ramps else value[last]
        first_s = max(first_s, float(at[0]) - half_s)
    frame = pd.DataFrame(found)
    return frame[frame["time"] >= first_s].reset_index(drop=True)


def _targets(message: Any, order: Sequence[str]) -> Iterator[tuple[float, Any, list[str]]]:
    """When after its stamp a message asks for what: a state, an array, or a trajectory's points."""
    if not hasattr(message, "points"):
        yield 0.0, message, _names(message) or list(order)
        return
    for point in message.points:
        after = point.time_from_start
        nanosec = getattr(after, "nanosec", getattr(after, "nsecs", 0))
        yield getattr(after, "sec", 0) + 1e-9 * nanosec, point, _names(message)


def _note(into: Series, message: Any, names: Sequence[str], time_s: float) -> None:
    """Write the numbers of joints at a time."""
    for kind in ("position", "velocity", "effort"):
        values = getattr(message, kind, getattr(message, f"{kind}s", ()))
        if kind == "position" and hasattr(message, "data"):
            values = message.data
        for name, value in zip(names, values, strict=False):
            into.setdefault(f"{name}.{kind}", []).append((time_s, float(value)))


def _names(message: Any) -> list[str]:
    return [str(n) for n in getattr(message, "name", getattr(message, "joint_names", ()))]


def _part(message: Any, side: int) -> Any:
    """What a controller asks for (0) or reads (1)."""
    return next(getattr(message, pair[side]) for pair in PAIRS if hasattr(message, pair[side]))


def _stamp(message: Any) -> float:
    """The time in a message's header [s]; 0: none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return stamp.sec + 1e-9 * stamp.nanosec if stamp is not None else 0.0
