"""Step SAPIEN by its public Python calls: the functions of `_sapien_calls`, for any wheel."""

from typing import Any

import numpy as np

from backends._calls import motor_step
from backends.state import Array

POINTER = object
"""What `pointer` gives, as an array holds it."""


def pointer(wrapped: Any) -> Any:
    """What the calls below take for a system or a hand: the object."""
    return wrapped


def rollout(
    systems: Array,
    hands: Array,
    place: Array,
    torque: Array,
    angle: Array,
    speed: Array,
    sticks: Array,
    carried: Array,
    force: Array,
) -> None:
    """See `_sapien_calls.rollout`."""
    none = np.zeros(3, dtype=np.float32)
    for n, (system, hand) in enumerate(zip(systems, hands, strict=True)):
        for tick in range(torque.shape[1]):
            if tick < carried[n]:
                sticks[n].add_force_torque(force[n].astype(np.float32), none)
            _push(hand, place, torque[n, tick])
            system.step()
            _read(hand, place, angle[n], speed[n])


def drive(
    systems: Array,
    hands: Array,
    place: Array,
    args: int,
    ticks: int,
    angle: Array,
    speed: Array,
    sticks: Array,
    carried: Array,
    force: Array,
) -> None:
    """See `_sapien_calls.drive`."""
    none = np.zeros(3, dtype=np.float32)
    for n, (system, hand) in enumerate(zip(systems, hands, strict=True)):
        for tick in range(ticks):
            if tick < carried[n]:
                sticks[n].add_force_torque(force[n].astype(np.float32), none)
            _push(hand, place, motor_step(args, n, tick, angle[n], speed[n]))
            system.step()
            _read(hand, place, angle[n], speed[n])


def read_sticks(sticks: Array, pos: Array, quat_wxyz: Array, vel: Array, omega: Array) -> None:
    """See `_sapien_calls.read_sticks`."""
    for n, stick in enumerate(sticks):
        pose = stick.entity_pose
        pos[n], quat_wxyz[n] = pose.p, pose.q
        vel[n], omega[n] = stick.linear_velocity, stick.angular_velocity


def read_contacts(systems: Array, tips: Array, dt: float) -> list[tuple]:
    """See `_sapien_calls.read_contacts`."""
    rows = []
    for n, (system, own) in enumerate(zip(systems, tips.tolist(), strict=True)):
        for contact in system.get_contacts():
            first, second = contact.shapes
            tip, side = (own.index(first), 1) if first in own else (own.index(second), -1)
            for point in contact.points:
                push = point.impulse / dt
                load = np.sqrt(np.sum(push * push))
                rows.append((n, tip, load, *load * point.position, *side * push))
    return rows


def _push(hand: Any, place: Array, torque: Array) -> None:
    """Set the joint torques (J,) of a hand; they stay until the next call."""
    values = np.empty(len(torque), dtype=np.float32)
    values[place] = torque
    hand.set_qf(values)


def _read(hand: Any, place: Array, angle: Array, speed: Array) -> None:
    """Read the joints of one hand."""
    angle[:], speed[:] = hand.get_qpos()[place], hand.get_qvel()[place]
