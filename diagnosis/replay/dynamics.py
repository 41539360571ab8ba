"""Rigid dynamics of a hand or a user's robot, without contacts, at many states at once.

    M(q) q'' + bias(q, q') = tau

Engines simulate the same equations, and parity tests check that. M is the sum over the bodies of
m Jv' Jv + Jw' I Jw; the bias is what their weight and their motion at zero joint acceleration
require, by Newton and Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008). All vectors are
in the world frame.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from backends.spec import Body, Spec
from backends.state import Array

POINTS = 4096
"""So many states at once are quicker than more, for they stay in a processor's cache."""


class _Frame(NamedTuple):
    """A body's frame at P states: the rates at zero joint acceleration, and what J joints move."""

    turn: Array
    """Rotation to the world's frame, shape (P, 3, 3)."""
    speed: Array
    """Angular velocity, shape (P, 3)."""
    rate: Array
    """Its derivative, shape (P, 3)."""
    acceleration: Array
    """Of the origin, shape (P, 3)."""
    moves: Array
    """Velocity of the origin by each joint's, shape (P, J, 3)."""
    turns: Array
    """Angular velocity by each joint's, shape (P, J, 3)."""

    def shifted(self, arm: Array) -> "_Frame":
        """The frame at a point of the body, at a distance (P, 3) from its origin."""
        inwards = np.cross(self.speed, np.cross(self.speed, arm))
        return self._replace(
            acceleration=self.acceleration + np.cross(self.rate, arm) + inwards,
            moves=self.moves + np.cross(self.turns, arm[:, None]),
        )


def dynamics(spec: Spec, q: Array, v: Array) -> tuple[Array, Array]:
    """Mass matrices (P, J, J) [kg m^2] and bias torques (P, J) [Nm] at q and v (P, J).

    Of slides kg and N. Nobody carries the weight of a payload beside the drives.
    """
    begins = range(0, max(len(q), 1), POINTS)
    parts = [_dynamics(spec, q[a : a + POINTS], v[a : a + POINTS]) for a in begins]
    mass, bias = (np.concatenate(every) for every in zip(*parts, strict=True))
    return mass, bias


def _dynamics(spec: Spec, q: Array, v: Array) -> tuple[Array, Array]:
    points, joints = q.shape
    mass, bias = np.zeros((points, joints, joints)), np.zeros((points, joints))
    still, unmoved = np.zeros((points, 3)), np.zeros((points, joints, 3))
    turn = np.broadcast_to(np.eye(3), (points, 3, 3))
    palm = _Frame(turn, still, still, still, unmoved, unmoved)
    frames: dict[str | None, _Frame] = {None: palm}
    gravity = np.array(spec.gravity_m_s2)
    for body in spec.hand.bodies:
        on_joint = frames[body.parent].shifted(frames[body.parent].turn @ body.origin_m)
        frame = frames[body.name] = _moved(on_joint, body, spec.hand.joint_names, q, v)
        inertia = frame.turn @ _tensor(body) @ frame.turn.transpose(0, 2, 1)
        spin = np.einsum("pij,pj->pi", inertia, frame.speed)
        moment = np.einsum("pij,pj->pi", inertia, frame.rate) + np.cross(frame.speed, spin)
        mass += frame.turns @ inertia @ frame.turns.transpose(0, 2, 1)
        bias += np.einsum("pji,pi->pj", frame.turns, moment)
        own = body.mass_kg, body.com_m, 1.0 - body.carried
        held = body.payload * body.mass_kg, body.end_m, 1.0
        for mass_kg, at_m, weight in (own, held) if body.payload else (own,):
            point = frame.shifted(frame.turn @ at_m)
            force = mass_kg * (point.acceleration - weight * gravity)
            mass += mass_kg * point.moves @ point.moves.transpose(0, 2, 1)
            bias += np.einsum("pji,pi->pj", point.moves, force)
    return mass, bias


def _moved(frame: _Frame, body: Body, joints: tuple[str, ...], q: Array, v: Array) -> _Frame:
    """The frame of a body that its joint moves from the frame that carries it."""
    joint = body.joint
    if joint.drive is None and joint.follows is None:
        return frame
    column = joints.index(joint.follows or joint.name)
    course = Polynomial(joint.course if joint.follows else (0.0, 1.0))
    at, slope, bend = (course.deriv(n)(q[:, column])[:, None] for n in range(3))
    axis = frame.turn @ joint.axis
    speed, rate = slope * v[:, [column]] * axis, bend * v[:, [column]] ** 2 * axis
    own = np.zeros_like(frame.turns)
    own[:, column] = slope * axis
    if joint.slides:
        end = frame.shifted(at * axis)
        rate = rate + 2.0 * np.cross(frame.speed, speed)
        return end._replace(acceleration=end.acceleration + rate, moves=end.moves + own)
    return frame._replace(
        turn=frame.turn @ Rotation.from_rotvec(at * joint.axis).as_matrix(),
        speed=frame.speed + speed,
        rate=frame.rate + np.cross(frame.speed, speed) + rate,
        turns=frame.turns + own,
    )


def _tensor(body: Body) -> Array:
    """Inertia about the centre of mass in the body's frame (3, 3) [kg m^2]."""
    (x, y, z), (xy, xz, yz) = body.inertia_kgm2, body.products_kgm2
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
