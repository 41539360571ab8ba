"""Forward kinematics of a hand in numpy, for N worlds at once.

Touch and initial states use it; parity tests hold every engine against it.
"""

from collections.abc import Sequence

import numpy as np

from backends.spec import Hand, Spec
from backends.state import Array


def hinge_rotation(axis: tuple[float, float, float], angle_rad: Array) -> Array:
    """Rotation matrices (N, 3, 3) about a unit `axis` by angles (N,) (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    return np.eye(3) + s * cross + (1 - c) * (cross @ cross)


def body_frames(hand: Hand, joint_rad: Array) -> dict[str, tuple[Array, Array]]:
    """Origin (N, 3) [m] and rotation (N, 3, 3) of every body, world frame, from (N, J) angles."""
    n = len(joint_rad)
    frames: dict[str | None, tuple[Array, Array]] = {
        None: (np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))
    }
    column = {name: j for j, name in enumerate(hand.joint_names)}
    for body in hand.bodies:
        origin, rotation = frames[body.parent]
        origin = origin + rotation @ np.array(body.origin_m)
        if body.joint.name in column:
            angle = joint_rad[:, column[body.joint.name]]
            rotation = rotation @ hinge_rotation(body.joint.axis, angle)
        frames[body.name] = (origin, rotation)
    return {name: frame for name, frame in frames.items() if name is not None}


def common_hand(specs: Sequence[Spec]) -> Hand:
    """The hand whose geometry and grasp all worlds share; raises ValueError where they differ."""

    def geometry(hand: Hand) -> tuple:
        bodies = tuple((b.parent, b.origin_m, b.joint.axis, b.joint.range_rad) for b in hand.bodies)
        t = hand.taxels
        taxels = (t.rows, t.columns, t.front_rad, t.half_width_rad)
        grasp = (hand.grip_m, hand.grasp_rad, hand.preload_rad)
        return bodies, hand.fingertips, taxels, grasp

    first = specs[0].hand
    if any(s.hand is not first and geometry(s.hand) != geometry(first) for s in specs):
        raise ValueError("worlds of one batch share the hand's geometry: make a batch for each")
    return first


def tip_frames(hand: Hand, joint_rad: Array) -> tuple[Array, Array]:
    """Origins (N, F, 3) [m] and rotations (N, F, 3, 3) of the fingertip frames, world frame."""
    frames = body_frames(hand, joint_rad)
    origins, rotations = [], []
    for tip in hand.fingertips:
        origin, rotation = frames[tip.body]
        local = np.array([tip.forward, tip.inward, np.cross(tip.forward, tip.inward)]).T
        origins.append(origin + rotation @ np.array(tip.center_m))
        rotations.append(rotation @ local)
    return np.stack(origins, axis=1), np.stack(rotations, axis=1)
