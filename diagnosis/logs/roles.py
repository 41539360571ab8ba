"""What the columns of a table are: joint, kind and unit, by their names.

Names are read as words: `Shoulder_Pan.goalPosition [deg]` is shoulder, pan, goal, position, deg.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

COMMAND = {"command", "commanded", "cmd", "target", "goal", "desired", "des", "ref", "reference"}
COMMAND |= {"setpoint", "set", "action", "sp", "demand", "demanded", "soll", "control", "ctrl"}
POSITION = {"position", "pos", "actual", "act", "measured", "meas", "present", "state", "angle"}
POSITION |= {"q", "qpos", "encoder", "feedback", "fb", "read", "reading", "ist"}
TORQUE, VELOCITY = {"torque", "tau", "effort", "trq", "force"}, {"velocity", "vel", "speed", "qd"}
VELOCITY |= {"dq", "qvel", "omega", "rpm"}
OTHER = {"current", "temperature", "temp", "voltage", "volt", "volts", "load", "error", "err"}
OTHER |= {"pwm", "status", "acc", "acceleration", "accel", "index", "duty", "amps", "power"}
FEED = {"feedforward", "ff", "feed", "forward"}
TIME = {"t", "time", "zeit", "timestamp", "stamp", "elapsed", "clock", "timestamps"}
EPISODE = {"episode", "run", "trial", "repetition"}
ANGLES = {
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
    **dict.fromkeys(("deg", "degree", "degrees"), 180 / np.pi),
    **dict.fromkeys(("turn", "turns", "rev", "revs", "rotations"), 1 / (2 * np.pi)),
    "mrad": 1e3,
}
"""Units of angles, per radian."""
LENGTHS = {"m": 1.0, "mm": 1e3, "cm": 1e2, "um": 1e6}
"""Units of lengths, per metre."""
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), 1e6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e9),
}
"""Units of times, per second."""
COUNTS = {"count", "counts", "tick", "ticks", "raw", "steps", "lsb"}
IDLE = {"joint", "jnt", "observation", "obs", "motor"}
"""Words that say nothing where they stand beside others."""
SAYING = COMMAND | POSITION | TORQUE | VELOCITY | OTHER | TIME | EPISODE | IDLE | COUNTS | FEED
SAYING |= {*ANGLES, *LENGTHS, *TIMES, "push", "nm", "n"}
"""Words that say of what kind a column is, or in which unit."""


@dataclass(frozen=True, kw_only=True)
class Role:
    """What a column is."""

    column: str
    joint: str
    kind: str
    """A kind of column, `bare` or `other`."""
    unit: str | None
    """A key of `ANGLES` or `LENGTHS`, `counts`, or None where the name has none."""


def words(name: str) -> list[str]:
    """The words and numbers of a name."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.replace("°", " deg ").replace("µ", "u"))
    return re.findall(r"[a-z]+|\d+", text.lower())


def time_column(names: Sequence[str]) -> str | None:
    """The column of time stamps."""
    found = [n for n in names if TIME & set(words(n)) and not (COMMAND | POSITION) & set(words(n))]
    return found[0] if found else None


def commands_else(names: Sequence[str]) -> bool:
    """Whether a column commands something that is no position."""
    other = TORQUE | VELOCITY | {"current", "pwm", "duty", "voltage"}
    return any(COMMAND & set(words(name)) and other & set(words(name)) for name in names)


def episode_column(names: Sequence[str]) -> str | None:
    """The column of episode numbers."""
    rest = EPISODE | {"index", "number", "id", "no"}
    found = [n for n in names if EPISODE & set(words(n)) and set(words(n)) <= rest]
    return found[0] if found else None


def roles(names: Sequence[str], joints: Sequence[str]) -> list[Role]:
    """What columns are of a model's joints; those that are of none are left out.

    Of a model with one joint, columns that name none are its own where their kind is known.
    """
    found = [(name, joint_named(name, joints)) for name in names]
    by_number = _numbered([name for name, joint in found if joint is None], joints)
    pairs = [(name, joint or by_number.get(name)) for name, joint in found]
    there = [_role(name, joint) for name, joint in pairs if joint is not None]
    if there or len(joints) != 1:
        return there
    alone = (_role(name, joints[0]) for name in names)
    return [role for role in alone if role.kind not in ("bare", "other")]


def joint_named(name: str, joints: Sequence[str]) -> str | None:
    """The joint whose words a column's name has in a row: that with the most."""
    have, best, most = words(name), None, 0
    for joint in joints:
        wanted = _own(joint)
        at = range(len(have) - len(wanted) + 1)
        if len(wanted) > most and any(have[k : k + len(wanted)] == wanted for k in at):
            best, most = joint, len(wanted)
    return best


def _own(joint: str) -> list[str]:
    """The words of a joint without those that say nothing."""
    every = words(joint)
    return [word for word in every if word not in IDLE] or every


def _numbered(names: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Columns such as q_0, q_1, ... in the order of the joints, where they are as many."""
    groups: dict[str, dict[int, str]] = {}
    for name in names:
        numbers = [word for word in words(name) if word.isdigit()]
        if len(numbers) == 1:
            stem = " ".join(word for word in words(name) if not word.isdigit())
            groups.setdefault(stem, {})[int(numbers[0])] = name
    return {
        group[number]: joint
        for group in groups.values()
        if len(group) == len(joints)
        for number, joint in zip(sorted(group), joints, strict=True)
    }


def _role(name: str, joint: str) -> Role:
    rest = set(words(name)) - set(_own(joint))
    units = [u for u in (*ANGLES, *(u for u in LENGTHS if u != "m")) if u in rest]
    unit = "counts" if COUNTS & rest else units[0] if units else "m" if "m" in rest else None
    return Role(column=name, joint=joint, kind=_kind(rest), unit=unit)


def _kind(rest: set[str]) -> str:
    rest = rest | {word[:-1] for word in rest if len(word) > 4 and word.endswith("s")}
    asked = bool(COMMAND & rest)
    if OTHER & rest:
        return "other"
    for kind, names in (("torque", TORQUE), ("velocity", VELOCITY)):
        if names & rest and FEED & rest:
            return "feedforward" if kind == "torque" else "other"
        if names & rest:
            return kind if not asked else "reference" if kind == "velocity" else "other"
    if asked:
        return "command"
    if "push" in rest:
        return "push"
    if POSITION & rest:
        return "position"
    return "motor" if "motor" in rest else "bare"


def joint_of(name: str) -> str:
    """What a column's name says beside its kind and unit: the joint's; 'joint' where nothing."""
    rest = [word for word in words(name) if word not in SAYING]
    return "_".join(rest) or "joint"
