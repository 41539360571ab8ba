"""Forward kinematics of a hand for N worlds at once: a numpy version, and a compiled one for touch.

Initial states use the numpy version. Tests compare every engine and the compiled version with it.
"""

from collections.abc import Sequence

import numba
import numpy as np

from backends.spec import Fingertip, Hand, Spec
from backends.state import Array


def hinge_rotation(axis: tuple[float, float, float], angle_rad: Array) -> Array:
    """Rotation matrices (N, 3, 3) about a unit `axis` by angles (N,) (Rodrigues' formula)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle_rad)[:, None, None], np.cos(angle_rad)[:, None, None]
    return np.eye(3) + s * cross + (1 - c) * (cross @ cross)


def body_frames(hand: Hand, joint_rad: Array) -> dict[str, tuple[Array, Array]]:
    """Origin (N, 3) [m] and rotation (N, 3, 3) of every body, world frame, from (N, J) angles.

    Positions of slides are in m.
    """
    n = len(joint_rad)
    frames: dict[str | None, tuple[Array, Array]] = {
        None: (np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))
    }
    column = {name: j for j, name in enumerate(hand.joint_names)}
    for body in hand.bodies:
        origin, rotation = frames[body.parent]
        origin = origin + rotation @ np.array(body.origin_m)
        if body.joint.name in column:
            moved, axis = joint_rad[:, column[body.joint.name]], body.joint.axis
            if body.joint.slides:
                origin = origin + moved[:, None] * (rotation @ np.array(axis))
            else:
                rotation = rotation @ hinge_rotation(axis, moved)
        frames[body.name] = (origin, rotation)
    return {name: frame for name, frame in frames.items() if name is not None}


def common_hand(specs: Sequence[Spec]) -> Hand:
    """The hand that all worlds share; raises ValueError where geometry or grasp differ."""

    def geometry(hand: Hand) -> tuple:
        bodies = tuple((b.parent, b.origin_m, b.joint.axis, b.joint.range_rad) for b in hand.bodies)
        t = hand.taxels
        taxels = (t.rows, t.columns, t.front_rad, t.half_width_rad)
        grasp = (hand.grip_m, hand.grasp_rad, hand.preload_rad)
        return bodies, hand.fingertips, taxels, grasp

    first = specs[0].hand
    if any(s.hand is not first and geometry(s.hand) != geometry(first) for s in specs):
        raise ValueError(
            "all worlds of one batch must have the same hand geometry; make a batch for each"
        )
    return first


def tip_frames(hand: Hand, joint_rad: Array) -> tuple[Array, Array]:
    """Origins (N, F, 3) [m] and rotations (N, F, 3, 3) of the fingertip frames, world frame."""
    frames = body_frames(hand, joint_rad)
    origins, rotations = [], []
    for tip in hand.fingertips:
        origin, rotation = frames[tip.body]
        origins.append(origin + rotation @ np.array(tip.center_m))
        rotations.append(rotation @ _tip_axes(tip))
    return np.stack(origins, axis=1), np.stack(rotations, axis=1)


def _tip_axes(tip: Fingertip) -> Array:
    """Rotation (3, 3) from the fingertip frame to its body's."""
    return np.array([tip.forward, tip.inward, np.cross(tip.forward, tip.inward)]).T


def tip_chain(hand: Hand) -> tuple[Array, ...]:
    """A hand's bodies and fingertips, as `tips_placed` takes them."""
    places = {body.name: i for i, body in enumerate(hand.bodies)}
    columns = {name: j for j, name in enumerate(hand.joint_names)}
    bodies, tips = hand.bodies, hand.fingertips
    return (
        np.array([-1 if b.parent is None else places[b.parent] for b in bodies]),
        np.array([columns.get(b.joint.name, -1) for b in bodies]),
        np.array([b.origin_m for b in bodies]),
        np.array([b.joint.axis for b in bodies]),
        np.array([places[tip.body] for tip in tips]),
        np.array([tip.center_m for tip in tips]),
        np.array([_tip_axes(tip) for tip in tips]),
    )


@numba.njit(cache=True)
def room(chain):
    """Room for the origins and rotations of all bodies of a chain, and of the world."""
    bodies = len(chain[0]) + 1
    return np.zeros((bodies, 3)), np.zeros((bodies, 3, 3))


@numba.njit(cache=True, forceinline=True)
def tips_placed(joint, chain, at, turn, origin, rotation):
    """Write the `tip_frames` of one hand, (F, 3) and (F, 3, 3), at angles (J,), up to rounding."""
    parent, column, offset, axis, tip_body, center, axes = chain
    placed(joint, parent, column, offset, axis, at, turn)
    for f in range(len(tip_body)):
        _place(at[tip_body[f]], turn[tip_body[f]], center[f], origin[f])
        _multiply(turn[tip_body[f]], axes[f], rotation[f])


@numba.njit(cache=True, forceinline=True)
def placed(joint, parent, column, offset, axis, at, turn):
    """Write origins (B + 1, 3) and rotations of all bodies at angles (J,); the last: the world's.

    `parent` (B,): -1: the world; `column` (B,): its joint, -1: none; `offset` and `axis` (B, 3).
    """
    for i in range(3):
        turn[-1, i, i] = 1.0
    for b in range(len(parent)):
        _place(at[parent[b]], turn[parent[b]], offset[b], at[b])
        if column[b] < 0:
            for i in range(3):
                for j in range(3):
                    turn[b, i, j] = turn[parent[b], i, j]
        else:
            _turn(turn[parent[b]], axis[b], joint[column[b]], turn[b])


@numba.njit(cache=True, forceinline=True)
def _place(at, turn, offset, out):
    for i in range(3):
        out[i] = at[i] + turn[i, 0] * offset[0] + turn[i, 1] * offset[1] + turn[i, 2] * offset[2]


@numba.njit(cache=True, forceinline=True)
def _multiply(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@numba.njit(cache=True, forceinline=True)
def _turn(frame, axis, angle, out):
    """Write a frame turned about its own axis, by Rodrigues' formula."""
    x, y, z = axis[0], axis[1], axis[2]
    s, c = np.sin(angle), np.cos(angle)
    v = 1.0 - c
    xx, xy, xz = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    yx, yy, yz = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    zx, zy, zz = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    for i in range(3):
        a, b, d = frame[i, 0], frame[i, 1], frame[i, 2]
        out[i, 0] = a * xx + b * yx + d * zx
        out[i, 1] = a * xy + b * yy + d * zy
        out[i, 2] = a * xz + b * yz + d * zz
