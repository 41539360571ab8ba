"""Observations: named channels in a fixed order, saved with a policy as its contract."""

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from backends.spec import Hand
from backends.state import Array, State, quat_z_axis
from backends.touch import Touch

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


@dataclass(frozen=True, kw_only=True)
class Percept:
    """All data from which an observation may be built, for N worlds."""

    state: State
    touch: Touch
    desired_axis: Array
    """u_d: unit vector from the reference point to the pivot, shape (N, 3)."""
    target_rad: Array
    """Commanded joint angles [rad], shape (N, J)."""


class Observation(ABC):
    """Base class of every observation: joint positions, u_d, and the channels of a subclass.

    A subclass named `Observation` in its own file is one observation.
    """

    def __init__(self, hand: Hand) -> None:
        self.hand = hand
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

    @property
    def width(self) -> int:
        """Length of the observation vector."""
        return sum(channel.width for channel in self.channels)

    def contract(self) -> dict:
        """The layout as plain data: the input that a saved policy expects."""
        return {
            "joints": list(self.hand.joint_names),
            "observation": [dataclasses.asdict(channel) for channel in self.channels],
            "action": {
                "name": "desired_joint_displacement",
                "unit": "rad",
                "width": len(self.hand.driven),
            },
        }

    def read(self, percept: Percept) -> Array:
        """Observation vectors, shape (N, width), float32; they share no memory with the state."""
        position = (percept.state.measured_rad - self._low) / self._span
        parts = [position, percept.desired_axis, *self.extra(percept)]
        return np.concatenate(parts, axis=1, dtype=np.float32)

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
