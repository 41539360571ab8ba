"""What policies see, and what their actions mean: the contract that is saved with each."""

import dataclasses
import json
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np

from backends.spec import Hand, Timing
from backends.state import Array, State, quat_z_axis
from backends.touch import Touch

SCHEMA = 2
"""Version of the contract; one without a number has the paper's law of actions."""
PER_JOINT = ("joint_position_over_range", "target_lead")
"""Channels with a number per joint, in the order of the contract's joints."""
CENTER_SCALE_M = 0.02
"""Scale by which contact centres and stick positions are divided [m]."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One named block of an observation vector."""

    name: str
    unit: str
    """Unit before scaling."""
    width: int
    scale: float
    """Scale by which the physical value is divided."""

    @property
    def per_joint(self) -> bool:
        """Whether it has a number per joint."""
        return self.name in PER_JOINT


class Percept(NamedTuple):
    """All data from which an observation may be built, for N worlds."""

    state: State
    touch: Touch
    desired_axis: Array
    """u_d: unit vector from the reference point to the pivot, shape (N, 3)."""
    target_rad: Array
    """Commanded joint angles [rad], shape (N, J)."""
    axes: Array
    """u_d at every step of each episode, shape (N, T, 3)."""
    steps: Array
    """Steps since the start of each episode, shape (N,)."""


@dataclass(frozen=True, kw_only=True)
class ActionLaw:
    """From a policy's actions to the joints' targets.

    target += scale clip(action, -1, 1) + target_return (rest - target)

    The target then stays within `target_lead` of the measured position, and within its range. At
    rest it is the preload beyond the measured position, or the default pose: with a return of 1 to
    that pose an action is a position beside it.
    """

    scale_rad: float = 0.015
    """Change of the target by a full action in one period [rad]."""
    period_s: float = Timing().policy_s
    """Time from one action to the next [s]."""
    target_return: float = 0.05
    """Share by which the target returns to its rest in one period [1].

    The lead over the measured position sets the squeeze, and no observation of the paper contains
    it. As a plain sum of actions it drifts away: the stick creeps down or is dropped. A time
    constant of 0.4 s bounds it. The observation `centers-and-lead`, which is not in the paper,
    contains it.
    """
    target_lead_rad: float = 0.2
    """Largest distance between target and measured position [rad]."""
    target_range_rad: tuple[tuple[float, float], ...]
    """Lowest and highest target of each joint [rad]."""
    preload_rad: tuple[float, ...] | None
    """Rest: target minus measured position [rad]; None: the default pose is the rest."""
    default_pose_rad: tuple[float, ...]
    """Joint angles at the middle of the initial states [rad]."""

    @classmethod
    def of(cls, hand: Hand) -> "ActionLaw":
        """That of the paper, for a hand."""
        return cls(
            target_range_rad=tuple(body.joint.range_rad for body in hand.driven),
            preload_rad=hand.preload_rad,
            default_pose_rad=hand.grasp_rad,
        )

    def displace(self, target: Array, measured: Array, action: Array) -> None:
        """Overwrite targets (N, J) [rad] by the next ones, for the measured positions [rad]."""
        _displace(target, measured, self.scale_rad * action, *self._numbers)

    @cached_property
    def _numbers(self) -> tuple:
        """The arguments of `_displace` behind the displacement."""
        is_preload = self.preload_rad is not None
        rest = np.array(self.preload_rad if is_preload else self.default_pose_rad)
        ends = np.array(self.target_range_rad).T
        return rest, is_preload, self.scale_rad, self.target_return, self.target_lead_rad, ends


@numba.njit(cache=True)
def _displace(target, measured, moved, rest, is_preload, most, back, lead, ends):
    most = moved.dtype.type(most)
    for n in range(target.shape[0]):
        for j in range(target.shape[1]):
            at, there = measured[n, j], target[n, j]
            goal = at + rest[j] if is_preload else rest[j]
            there += min(max(moved[n, j], -most), most) + back * (goal - there)
            there = min(max(there, at - lead), at + lead)
            target[n, j] = min(max(there, ends[0, j]), ends[1, j])


@numba.njit(cache=True, error_model="numpy")
def _first(measured, low, span, axis, rows):
    """Write joint positions over their ranges, then u_d, into the first columns."""
    joints = len(low)
    for n in range(len(rows)):
        for j in range(joints):
            rows[n, j] = (measured[n, j] - low[j]) / span[j]
        for i in range(3):
            rows[n, joints + i] = axis[n, i]


class Observation(ABC):
    """Base class of every observation: joint positions, u_d, and the channels of a subclass.

    A subclass named `Observation` in its own file is one observation.
    """

    def __init__(self, hand: Hand, law: ActionLaw | None = None) -> None:
        """`law`: what actions mean; None: as in the paper."""
        self.hand, self.law = hand, law or ActionLaw.of(hand)
        self.order = tuple(range(len(hand.driven)))
        """Which joint of the contract each joint of the hand is."""
        ranges = np.array([b.joint.range_rad for b in hand.driven])
        self._low, self._span = ranges[:, 0], ranges[:, 1] - ranges[:, 0]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The channels, in order."""
        joints = len(self.hand.driven)
        return (
            Channel(name="joint_position_over_range", unit="1", width=joints, scale=1.0),
            Channel(name="desired_axis", unit="1", width=3, scale=1.0),
            *self.extra_channels(),
        )

    @cached_property
    def width(self) -> int:
        """Length of the observation vector."""
        return sum(channel.width for channel in self.channels)

    def contract(self) -> dict:
        """What a saved policy sees and what its actions mean, as plain data."""
        return {
            "schema": SCHEMA,
            "joints": list(self.hand.joint_names),
            "observation": [dataclasses.asdict(channel) for channel in self.channels],
            "action": {
                "name": "desired_joint_displacement",
                "unit": "rad",
                "width": len(self.hand.driven),
                "range": [-1, 1],
                **json.loads(json.dumps(dataclasses.asdict(self.law))),
            },
        }

    def read(self, percept: Percept) -> Array:
        """Observation vectors, shape (N, width), float32; they share no memory with the state."""
        rows = np.empty((len(percept.desired_axis), self.width), dtype=np.float32)
        _first(percept.state.measured_rad, self._low, self._span, percept.desired_axis, rows)
        at = len(self._low) + 3
        for part in self.extra(percept):
            rows[:, at : at + part.shape[1]] = part
            at += part.shape[1]
        return rows

    @abstractmethod
    def extra_channels(self) -> tuple[Channel, ...]:
        """The channels that follow joint positions and u_d."""

    @abstractmethod
    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """Values of the extra channels, each (N, width)."""


def center_channel(hand: Hand) -> Channel:
    """The contact centres of all fingertips."""
    width = 3 * len(hand.fingertips)
    return Channel(name="contact_center", unit="m", width=width, scale=CENTER_SCALE_M)


def centers(percept: Percept) -> Array:
    """Scaled contact centres in their fingertip frames, shape (N, 3 F)."""
    return percept.touch.center_m.reshape(len(percept.touch.center_m), -1) / CENTER_SCALE_M


POSE_CHANNELS = (
    Channel(name="stick_position_from_grip", unit="m", width=3, scale=CENTER_SCALE_M),
    Channel(name="stick_axis", unit="1", width=3, scale=1.0),
)


def pose(hand: Hand, percept: Percept) -> tuple[Array, Array]:
    """Scaled stick centre relative to the grip and the stick's axis, each (N, 3)."""
    state = percept.state
    position = (state.stick_pos_m - np.array(hand.grip_m)) / CENTER_SCALE_M
    return position, quat_z_axis(state.stick_quat_wxyz)
