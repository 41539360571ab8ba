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
TORQUE = {"torque", "tor", "tau", "effort", "trq", "force", "moment", "drehmoment", "kraft"}
VELOCITY = {"velocity", "vel", "speed", "qd", "dq", "qvel", "omega", "rpm"}
OTHER = {"current", "temperature", "temp", "voltage", "volt", "volts", "load", "error", "err"}
OTHER |= {"pwm", "status", "acc", "acceleration", "accel", "index", "duty", "amps", "power"}
GAINS = "kp", "kd"
FEED = {"feedforward", "ff", "feed", "forward"}
BY_CONSTANT = {"current", "amps", "ma", "duty", "pwm", "voltage", "volt", "volts", "mv"}
"""What makes a torque by a constant of the drive."""
PLACE = {"position", "pos", "angle", "q", "qpos"}
ERROR, FOLLOWING = {"error", "err"}, {"tracking", "following", "follow"}
TIME = {"t", "ts", "time", "zeit", "timestamp", "stamp", "elapsed", "clock", "timestamps"}
TIME |= {"date", "datetime", "millis", "micros", "nanos"}
EPISODE = {"episode", "run", "trial", "repetition", "stroke", "cycle"}
ANGLES = {
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
    **dict.fromkeys(("deg", "degree", "degrees"), 180 / np.pi),
    **dict.fromkeys(("turn", "turns", "rev", "revs", "rotations"), 1 / (2 * np.pi)),
    "mrad": 1e3,
}
"""Units of angles, per radian."""
LENGTHS = {"m": 1.0, "mm": 1e3, "cm": 1e2, "um": 1e6}
"""Units of lengths, per metre."""
EFFORTS = {"nm": 1.0, "n": 1.0, "mnm": 1e3, "nmm": 1e3, "ncm": 1e2, "mn": 1e3, "kn": 1e-3}
EFFORTS |= {"ma": 1e3, "mv": 1e3, "percent": 1e2}
"""Units of torques and forces, per Nm or N; of what makes them, per A, V or whole duty cycle."""
EFFORT = re.compile(r"(?<![A-Za-z])(m?N[cm]?m|m[NAV]|kN)(?![A-Za-z])")
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), 1e6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e9),
}
"""Units of times, per second."""
COUNTS = {"count", "counts", "tick", "ticks", "raw", "steps", "lsb"}
IDLE = {"joint", "jnt", "observation", "obs", "motor", "value", "values", "val"}
"""Words that say nothing where they stand beside others."""
SAYING = COMMAND | POSITION | TORQUE | VELOCITY | OTHER | TIME | EPISODE | IDLE | COUNTS | FEED
SAYING |= {*ANGLES, *LENGTHS, *TIMES, *EFFORTS, *FOLLOWING, *GAINS, "push"}
"""Words that say of what kind a column is, or in which unit."""
BOTH = COMMAND | POSITION
UNITS = {*ANGLES, *LENGTHS}
BRACKETS = re.compile(r"\[[^\]]*\]|\([^)]*\)")


@dataclass(frozen=True, kw_only=True)
class Role:
    """What a column is."""

    column: str
    joint: str
    kind: str
    """A kind of column, `effort` (a torque that is asked, or what makes it), `draw` (what makes a
    torque, measured), `error` (by which a position misses its target), one of `GAINS`, `bare` or
    `other`."""
    unit: str | None
    """A key of `ANGLES`, `LENGTHS` or `EFFORTS`, `counts`, or None where the name has none."""
    missed: bool = False
    """Whether a position is said by what it misses its target by."""


def words(name: str) -> list[str]:
    """The words and numbers of a name."""
    name = name.replace("°", " deg ").replace("µ", "u").replace("%", " percent ")
    name = EFFORT.sub(lambda unit: unit[0].lower(), name)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[a-z]+|\d+", text.lower())


def time_column(names: Sequence[str]) -> str | None:
    """The column of time stamps."""
    return next((n for n in names if TIME & {*words(n)} and not BOTH & {*words(n)}), None)


def episode_column(names: Sequence[str]) -> str | None:
    """The column of episode numbers."""
    rest = EPISODE | {"index", "number", "id", "no"}
    return next((n for n in names if EPISODE & {*words(n)} and {*words(n)} <= rest), None)


def roles(names: Sequence[str], joints: Sequence[str]) -> list[Role]:
    """What columns are of a model's joints; those that are of none are left out.

    Of a model with one joint, columns that name none are its own where their kind is known.
    Columns such as q_0, q_1, ... are in the order of the joints, where they are as many.
    """
    found = {name: joint_named(name, joints) for name in names}
    groups: dict[str, dict[int, str]] = {}
    for name in (name for name, joint in found.items() if joint is None):
        numbers = [word for word in words(name) if word.isdigit()]
        if len(numbers) == 1:
            stem = " ".join(word for word in words(name) if not word.isdigit())
            groups.setdefault(stem, {})[int(numbers[0])] = name
    for group in groups.values():
        if len(group) == len(joints):
            found |= {group[k]: joint for k, joint in zip(sorted(group), joints, strict=True)}
    there = [_role(name, joint) for name, joint in found.items() if joint is not None]
    if there or len(joints) != 1:
        return there
    alone = (_role(name, joints[0]) for name in names)
    return [role for role in alone if role.kind not in ("bare", "other")]


def joint_named(name: str, joints: Sequence[str]) -> str | None:
    """The joint whose words a column's name has in a row: the first of those with the most."""
    have = f" {' '.join(words(_apart(name)[0]))} "
    named = [j for j in joints if (own := _own(j)) and f" {' '.join(own)} " in have]
    return max(named, key=lambda joint: len(_own(joint)), default=None)


def _apart(name: str) -> tuple[str, str]:
    """A name without what stands in brackets where that is a unit alone, and the unit."""
    units = {*UNITS, *EFFORTS, *TIMES, *COUNTS}
    inside = [part for part in BRACKETS.findall(name) if {*words(part)} <= units]
    for part in inside:
        name = name.replace(part, " ")
    return name, " ".join(inside)


def _own(joint: str) -> list[str]:
    """The words of a joint without those that say nothing."""
    every = words(joint)
    return [word for word in every if word not in IDLE] or every


def _role(name: str, joint: str) -> Role:
    plain, unit_said = _apart(name)
    rest = {*words(plain)} - {*_own(joint)} | {*words(unit_said)}
    many = {word for word in rest if len(word) > 4 and word.endswith("s")}
    kind = _kind(rest | {word[:-1] for word in many} | {word[:-3] + "y" for word in many})
    efforts = kind in ("torque", "effort", "feedforward", "draw")
    sizes = EFFORTS if efforts else ANGLES | LENGTHS
    units = [u for u in sizes if u in rest]
    unit = next((u for u in units if u != "m"), "m" if units else None)
    return Role(column=name, joint=joint, kind=kind, unit="counts" if COUNTS & rest else unit)


def _kind(rest: set[str]) -> str:
    asked = bool(COMMAND & rest)
    if gains := rest.intersection(GAINS):
        return min(gains)
    if FEED & rest and (TORQUE | VELOCITY) & rest:
        return "feedforward" if TORQUE & rest else "other"
    if asked and (BY_CONSTANT | TORQUE | EFFORTS.keys()) & rest:
        return "effort"
    if ERROR & rest and (rest & (POSITION | FOLLOWING) or rest <= ERROR | UNITS):
        return "error"
    if "current" in rest and PLACE & rest:  # the present one
        return "command" if asked else "position"
    if BY_CONSTANT & rest:
        return "draw"
    if OTHER & rest:
        return "other"
    if TORQUE & rest:
        return "torque"
    if VELOCITY & rest:
        return "reference" if asked else "velocity"
    if asked or "push" in rest:
        return "command" if asked else "push"
    return "position" if POSITION & rest else "motor" if "motor" in rest else "bare"


def joint_of(name: str) -> str:
    """What a column's name says beside its kind and unit: the joint's; 'joint' where nothing."""
    rest = [word for word in words(name) if word not in SAYING]
    return "_".join(rest) or "joint"
