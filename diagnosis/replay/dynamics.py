"""Rigid dynamics of a hand or a user's robot, without contacts, at many states at once.

    M(q) q'' + bias(q, q') = tau

Engines simulate the same equations, and parity tests check that. M is the sum over the bodies of
m Jv' Jv + Jw' I Jw; the bias is what their weight and their motion at zero joint acceleration
require, by Newton and Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008). All vectors are
in the world frame.

One or two joints have a closed form, exact and without the recursion. For hinges in a chain the
mass matrix is a trigonometric polynomial of degree two in the second angle, and gravity's torques
are of degree one in each angle. Their values at a few poses give the coefficients exactly; the
other velocity terms follow from the mass matrix (Christoffel symbols: Spong, Hutchinson and
Vidyasagar, Robot Modeling and Control, 2006, chapter 7). Of slides alone both are constant.
"""

from typing import NamedTuple

import numba
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


def link_inertia(mass: Array) -> Array:
    """The least inertia that each joint moves alone (K,), of mass matrices (P, K, K)."""
    return (1.0 / np.diagonal(np.linalg.inv(mass), axis1=1, axis2=2)).min(axis=0)


def _tensor(body: Body) -> Array:
    """Inertia about the centre of mass in the body's frame (3, 3) [kg m^2]."""
    (x, y, z), (xy, xz, yz) = body.inertia_kgm2, body.products_kgm2
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])


POSES = np.array([(a / 3, b / 5) for a in range(3) for b in range(5)]) * 2 * np.pi
"""Angles of two joints (15, 2) whose masses and torques give all coefficients; of one the first."""
_FIRST, _SECOND = POSES.T
_WAVES = np.stack(
    [
        first * second
        for first in (np.ones(15), np.cos(_FIRST), np.sin(_FIRST))
        for second in (1.0, *(f(n * _SECOND) for n in (1, 2) for f in (np.cos, np.sin)))
    ]
)


def is_closed(spec: Spec) -> bool:
    """Whether the closed form holds: of one or two joints alike, which no other follows."""
    slides = [body.joint.slides for body in spec.hand.driven]
    follows = any(body.joint.follows for body in spec.hand.bodies)
    return len(slides) <= 2 and len(set(slides)) == 1 and not follows


def coefficients(mass: Array, bias: Array) -> Array:
    """Of m11, m12, m22, h1 and h2 by waves of both angles (5, 3, 5).

    From masses (15, K, K) and torques (15, K) at `POSES`.
    """
    rows = mass[:, 0, 0], mass[:, 0, -1], mass[:, -1, -1], bias[:, 0], bias[:, -1]
    return (np.stack(rows) @ np.linalg.inv(_WAVES)).reshape(5, 3, 5)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def closed_form(x, q, v, mass, bias):
    """Write M (K, K) and h (K,) at q and v (K,), by `coefficients`."""
    a, b, c, s = np.cos(q[0]), np.sin(q[0]), 1.0, 0.0
    if len(q) > 1:
        c, s = np.cos(q[1]), np.sin(q[1])
    c2, s2 = c * c - s * s, 2.0 * c * s
    for j in range(len(q)):
        bias[j] = _sum(x[3 + j, 0], c, s, c2, s2)
        bias[j] += a * _sum(x[3 + j, 1], c, s, c2, s2) + b * _sum(x[3 + j, 2], c, s, c2, s2)
    mass[0, 0] = _sum(x[0, 0], c, s, c2, s2)
    if len(q) > 1:
        mass[0, 1] = mass[1, 0] = _sum(x[1, 0], c, s, c2, s2)
        mass[1, 1] = x[2, 0, 0]
        d11, d12 = _slope(x[0, 0], c, s, c2, s2), _slope(x[1, 0], c, s, c2, s2)
        bias[0] += v[1] * (d11 * v[0] + d12 * v[1])
        bias[1] -= 0.5 * d11 * v[0] * v[0]


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _sum(row, c, s, c2, s2):
    return row[0] + c * row[1] + s * row[2] + c2 * row[3] + s2 * row[4]


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _slope(row, c, s, c2, s2):
    return c * row[2] - s * row[1] + 2.0 * (c2 * row[4] - s2 * row[3])
