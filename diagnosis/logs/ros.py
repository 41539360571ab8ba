"""Recordings of ROS 2 (rosbag2 folders, `.db3`, `.mcap`) and ROS 1 (`.bag`) as a table.

Readings come from a JointState, commands from a trajectory, a second JointState, an array of
numbers, or from a controller's state, which holds both. A row is a message: readers of tables put
commands and readings together.
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
ASKED = {"position": "command", "velocity": "velocity_command", "effort": "effort_ff"}
READ = {kind: kind for kind in ASKED}
"""What columns are called that ask for something, and that read it."""


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
        if kind == TRAJECTORY
        or (
            kind in (STATE, ARRAY) and any({w, w.removesuffix("s")} & COMMAND for w in words(topic))
        )
    }
    states = [topic for topic, kind in topics.items() if kind == STATE and topic not in asked]
    if len(states) == 1 and len(asked) == 1:
        return {states[0]: "state", **asked}
    there = ", ".join(f"{topic} ({kind})" for topic, kind in topics.items())
    raise LogError(
        f"one JointState and one topic of commands are needed, or a controller's state; the "
        f"recording has {there or 'none'}: record the two, or filter the others out"
    )


def _table(messages: Sequence[tuple[str, float, Any]]) -> pd.DataFrame:
    """A row per message, or per point of a trajectory, by time; raises LogError.

    A trajectory moves linearly from where its message finds it to each of its points.
    """
    order = next((_names(message) for role, _, message in messages if role != "command"), [])
    rows, due = list[dict[str, float]](), dict[str, tuple[float, float]]()
    for role, bag_s, message in messages:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        ramps = hasattr(message, "points")
        when_s = (stamp.sec + 1e-9 * stamp.nanosec if stamp is not None else 0.0) or bag_s
        if ramps:
            rows.append({"time": when_s, **{n: x for n, (at, x) in due.items() if at < when_s}})
        for after_s, said in _said(role, message, _names(message) or order):
            rows.append({"time": when_s + after_s, **said})
            due |= {name: (when_s + after_s, x) for name, x in said.items()} if ramps else {}
    frame = pd.DataFrame(rows).sort_values("time", kind="stable", ignore_index=True)
    for what in ("position", "command"):
        if not any(name.endswith(f".{what}") for name in frame):
            raise LogError(f"it has no {what}s of joints")
    for name in due:
        at_s = frame["time"][frame[name].notna()]
        frame[name] = np.interp(frame["time"], at_s, frame[name].dropna(), left=np.nan)
    return frame


def _said(
    role: str, message: Any, names: Sequence[str]
) -> Iterator[tuple[float, dict[str, float]]]:
    """When after its stamp [s] a message reads or asks for what, by column."""
    if role == "both":
        asked, read = next(pair for pair in PAIRS if hasattr(message, pair[0]))
        known = _numbers(getattr(message, read), names)
        yield 0.0, known | _numbers(getattr(message, asked), names, ASKED)
    elif role == "state":
        yield 0.0, _numbers(message, names)
    else:
        for point in getattr(message, "points", [message]):
            after = getattr(point, "time_from_start", None)
            nanosec = getattr(after, "nanosec", getattr(after, "nsecs", 0))
            yield getattr(after, "sec", 0) + 1e-9 * nanosec, _numbers(point, names, ASKED)


def _numbers(
    message: Any, names: Sequence[str], called: Mapping[str, str] = READ
) -> dict[str, float]:
    """The numbers of joints in a message, by column."""
    every = {kind: getattr(message, kind, getattr(message, f"{kind}s", ())) for kind in READ}
    every["position"] = getattr(message, "data", every["position"])
    pairs = ((kind, zip(names, values, strict=False)) for kind, values in every.items())
    return {f"{name}.{called[kind]}": float(x) for kind, pair in pairs for name, x in pair}


def _names(message: Any) -> list[str]:
    return [str(n) for n in getattr(message, "name", getattr(message, "joint_names", ()))]
