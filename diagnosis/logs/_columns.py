"""Names of a log's columns: kind, unit and joint, such as 'torque_nm.J0'."""

import difflib

import numpy as np

from diagnosis.logs._meta import LogError
from files.bounded import one_line

KINDS = {
    "command": "angle",
    "position": "angle",
    "motor": "angle",
    "torque": "torque",
    "velocity": "speed",
    "push": "torque",
    "reference": "speed",
    "feedforward": "torque",
}
"""Kinds of columns, and what each is of.

`reference` is the speed of the target, `feedforward` a torque that the drive adds to its law's.
"""
HINGE = {"angle": ("rad", "rad"), "torque": ("nm", "Nm"), "speed": ("rad_s", "rad/s")}
SLIDE = {"angle": ("m", "m"), "torque": ("n", "N"), "speed": ("m_s", "m/s")}
"""The unit in a column's name and the unit itself; the torque of a slide is a force."""
SHOWN = {False: (180 / np.pi, "deg", "Nm"), True: (1e3, "mm", "N")}
"""How a hinge (False) or slide (True) is shown: what positions are times, their unit, torques'."""
STICK = tuple(f"stick_{c}" for c in ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"))
"""Centre of the stick [m] and its orientation, world frame."""
PULL = "pull_n"
"""Known force on the stick along its axis, towards its lower end [N]."""
SENT = "sent_s"
"""When the command of a row begins to act [s], where that is not with its row."""
UNITS: dict[str, tuple[str, ...]] = {
    f"{kind}_{u[of][0]}": (u[of][1],) for u in (HINGE, SLIDE) for kind, of in KINDS.items()
}
UNITS |= {"touch": ("m", "1"), "stick": ("m",), PULL: ("N",), SENT: ("s",)}
"""Channels and the units in which they may be declared."""
WHOLE = ("stick", PULL, SENT)
"""Channels that belong to no joint or finger."""


def name_of(kind: str, joint: str, linear: bool = False) -> str:
    """The column name of a kind and joint."""
    return f"{kind}_{(SLIDE if linear else HINGE)[KINDS[kind]][0]}.{joint}"


def channel_of(column: str) -> str:
    """The channel that a column belongs to; raises LogError for an unknown name."""
    if column in STICK:
        return "stick"
    if column in (PULL, SENT):
        return column
    channel, dot, what = column.partition(".")
    if channel in UNITS and channel not in WHOLE and dot and what:
        return channel
    joints = [f"{c}.{what or 'JOINT'}" for c in UNITS if c not in WHOLE]
    names = ["episode", "t_s", *STICK, PULL, SENT, *joints]
    near = difflib.get_close_matches(column, names, n=1, cutoff=0.5)
    hint = f" Did you mean '{near[0]}'?" if near else ""
    raise LogError(
        f"samples have an unknown column '{one_line(column, 60)}'; allowed: "
        f"{', '.join(['episode', 't_s', *UNITS])}.{hint} Rename or remove it"
    )


def kind_of(column: str) -> tuple[str, str] | None:
    """Kind and joint of a joint's column; None for other columns."""
    channel, _, joint = column.partition(".")
    kind = channel.split("_")[0]
    return (kind, joint) if channel in UNITS and kind in KINDS else None
