"""Rigid dynamics of a hand or a user's robot, without contacts, at many states at once.

    M(q) q'' + bias(q, q') = tau

Engines simulate the same equations, and parity tests check that. Both are what given accelerations
require, by Newton and Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5): the
bias without any, a column of M for that of one joint alone, at rest and without weight. Vectors are
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

from backends.spec import Body, Spec, Vec3
from backends.state import Array

_inlined = numba.njit(cache=True, error_model="numpy", forceinline=True)


class _Links(NamedTuple):
    """The B bodies of a mechanism as compiled code has them, every body after its parent."""

    parent: Array
    """Numbers of the bodies that carry them, -1: the palm; shape (B,)."""
    column: Array
    """The joint that moves each, or that it follows; -1: none does; shape (B,)."""
    slides: Array
    course: Array
    """Coefficients of its position over its joint's, from the constant one on, shape (B, C)."""
    origin_m: Array
    axis: Array
    mass_kg: Array
    """Of the body and of its payload, shape (B, 2)."""
    at_m: Array
    """Where these masses are, in its frame, shape (B, 2, 3)."""
    inertia_kgm2: Array
    """About the body's centre of mass, shape (B, 3, 3)."""
    weight: Array
    """Shares of these masses' weight that the drives bear, shape (B, 2)."""


def _links(spec: Spec) -> _Links:
    bodies, joints = spec.hand.bodies, spec.hand.joint_names
    names = [body.name for body in bodies]
    course = np.zeros((len(bodies), max(2, *(len(b.joint.course) for b in bodies))))
    column = np.full(len(bodies), -1)
    for n, body in enumerate(bodies):
        own = body.joint.course if body.joint.follows else (0.0, 1.0)
        course[n, : len(own)] = own
        if body.joint.follows or body.joint.drive is not None:
            column[n] = joints.index(body.joint.follows or body.joint.name)
    return _Links(
        parent=np.array([-1 if b.parent is None else names.index(b.parent) for b in bodies]),
        column=column,
        slides=np.array([b.joint.slides for b in bodies]),
        course=course,
        origin_m=np.array([b.origin_m for b in bodies], dtype=float),
        axis=np.array([b.joint.axis for b in bodies], dtype=float),
        mass_kg=np.array([[b.mass_kg, b.payload * b.mass_kg] for b in bodies], dtype=float),
        at_m=np.array([[b.com_m, b.payload_m] for b in bodies], dtype=float),
        inertia_kgm2=np.array([_tensor(b) for b in bodies]),
        weight=np.array([[1.0 - b.carried, 1.0] for b in bodies], dtype=float),
    )


def dynamics(spec: Spec, q: Array, v: Array) -> tuple[Array, Array]:
    """Mass matrices (P, J, J) [kg m^2] and bias torques (P, J) [Nm] at q and v (P, J).

    Of slides kg and N. Nobody carries the weight of a payload beside the drives.
    """
    links, still, mass = _links(spec), np.zeros_like(q), np.empty((*q.shape, q.shape[1]))
    for j, unit in enumerate(np.eye(q.shape[1])):
        mass[:, :, j] = _torques(links, np.zeros(3), q, still, still + unit)
    return mass, bias_torques(spec, q, v)


def bias_torques(spec: Spec, q: Array, v: Array) -> Array:
    """The bias torques alone."""
    return _torques(_links(spec), np.array(spec.gravity_m_s2, dtype=float), q, v, np.zeros_like(q))


def springs(spec: Spec, q: Array) -> Array:
    """Torques (P, J) against the springs of drives at q (P, J), which no bias torque has."""
    rows = [(drive.spring_nm_rad, drive.spring_rest_rad) for drive in spec.drives]
    stiffness, rest = np.array(rows).T
    return np.asarray(stiffness * (q - rest))


def holding(spec: Spec, q: Array) -> Array:
    """Torques (P, J) that hold joints at rest at q (P, J): against weight and springs."""
    return bias_torques(spec, q, np.zeros_like(q)) + springs(spec, q)


def carried(spec: Spec, q: Array) -> Array:
    """Torques (P, J) by which drives carry weight beside their laws, at q (P, J)."""
    links = _links(spec)
    share = 1.0 - links.weight
    gravity, still = np.array(spec.gravity_m_s2, dtype=float), np.zeros_like(q)
    return _torques(links._replace(weight=share), gravity, q, still, still)


def weights(spec: Spec, q: Array) -> Array:
    """Bias torques at rest by axis of a gravity of one [Nm/(m/s^2)], shape (P, J, 3)."""
    return _weights(_links(spec), q)


def of_point(spec: Spec, joint: str, at_m: Vec3, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """What a kilogram at a place on a joint's link adds to the dynamics at q and v (P, J).

    To the mass matrices (P, J, J), to the bias torques without weight (P, J), and to `weights`.
    """
    links, number = _links(spec), [body.joint.name for body in spec.hand.bodies].index(joint)
    mass, at = np.zeros_like(links.mass_kg), np.zeros_like(links.at_m)
    mass[number, 0], at[number, 0] = 1.0, at_m
    none = np.zeros_like(links.inertia_kgm2)
    alone = links._replace(mass_kg=mass, at_m=at, inertia_kgm2=none, weight=np.ones_like(mass))
    turning = _torques(alone, np.zeros(3), q, v, np.zeros_like(q))
    weight = _weights(alone, q)  # the point's Jacobian, transposed, against gravity
    return weight @ weight.transpose(0, 2, 1), turning, weight


def _weights(links: _Links, q: Array) -> Array:
    still = np.zeros_like(q)
    return np.stack([_torques(links, axis, q, still, still) for axis in np.eye(3)], axis=2)


@numba.njit(cache=True, error_model="numpy")
def _torques(links, gravity, q, v, a):
    """Torques (P, J) that accelerations `a` take at q and v (P, J), under gravity (3,)."""
    parent, column, slides, course, origin, axes, mass, at, inertia, weight = links
    bodies, out = len(parent), np.zeros_like(q)
    # Palm last, so that a parent of -1 is the palm.
    turn = np.zeros((bodies + 1, 3, 3))
    turn[-1] = np.eye(3)
    speeds, rates, accels, forces, moments = np.zeros((5, bodies + 1, 3))
    arms, lines, slopes = np.zeros((bodies, 3)), np.zeros((bodies, 3)), np.zeros(bodies)
    for p in range(len(q)):
        for b in range(bodies):
            up, j, place, slope, bend = parent[b], column[b], 0.0, 0.0, 0.0
            for n in range(course.shape[1] - 1, -1 if j >= 0 else course.shape[1] - 1, -1):
                bend = bend * q[p, j] + 2.0 * slope
                slope = slope * q[p, j] + place
                place = place * q[p, j] + course[b, n]
            arm, line = _to_world(turn[up], _row(origin, b)), _to_world(turn[up], _row(axes, b))
            spin, rate = _row(speeds, up), _row(rates, up)
            accel = _row(accels, up)
            own = own_rate = (0.0, 0.0, 0.0)
            if j >= 0:
                own = _times(slope * v[p, j], line)
                own_rate = _times(slope * a[p, j] + bend * v[p, j] ** 2, line)
            if slides[b]:
                arm = _plus(arm, _times(place, line))
                accel = _plus(accel, _plus(own_rate, _times(2.0, _cross(spin, own))))
                own = own_rate = (0.0, 0.0, 0.0)
                place = 0.0
            accel = _plus(accel, _swung(rate, spin, arm))
            rate = _plus(rate, _plus(_cross(spin, own), own_rate))
            spin = _plus(spin, own)
            _turn(turn[b], turn[up], _row(axes, b), place)
            body_spin, body_rate = _to_body(turn[b], spin), _to_body(turn[b], rate)
            gyro = _cross(body_spin, _to_world(inertia[b], body_spin))
            moment = _to_world(turn[b], _plus(_to_world(inertia[b], body_rate), gyro))
            force = (0.0, 0.0, 0.0)
            for n in range(2 if mass[b, 1] != 0.0 else 1):
                far = _to_world(turn[b], _row(at[b], n))
                fall = _times(-weight[b, n], (gravity[0], gravity[1], gravity[2]))
                push = _times(mass[b, n], _plus(_plus(accel, _swung(rate, spin, far)), fall))
                force, moment = _plus(force, push), _plus(moment, _cross(far, push))
            slopes[b] = slope
            _put(arms, b, arm), _put(lines, b, line), _put(speeds, b, spin), _put(rates, b, rate)
            _put(accels, b, accel), _put(forces, b, force), _put(moments, b, moment)
        for b in range(bodies - 1, -1, -1):
            force, moment, up = _row(forces, b), _row(moments, b), parent[b]
            if column[b] >= 0:
                along = _dot(_row(lines, b), force if slides[b] else moment)
                out[p, column[b]] += slopes[b] * along
            moment = _plus(moment, _cross(_row(arms, b), force))
            _put(forces, up, _plus(_row(forces, up), force))
            _put(moments, up, _plus(_row(moments, up), moment))
    return out


@_inlined
def _row(x, n):
    return x[n, 0], x[n, 1], x[n, 2]


@_inlined
def _put(x, n, a):
    x[n, 0], x[n, 1], x[n, 2] = a


@_inlined
def _plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@_inlined
def _times(by, a):
    return by * a[0], by * a[1], by * a[2]


@_inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_inlined
def _cross(a, b):
    x, y = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]
    return x, y, a[0] * b[1] - a[1] * b[0]


@_inlined
def _swung(rate, spin, arm):
    """Acceleration of a point at `arm` from one that does not accelerate."""
    return _plus(_cross(rate, arm), _cross(spin, _cross(spin, arm)))


@_inlined
def _to_world(turn, a):
    return _dot(_row(turn, 0), a), _dot(_row(turn, 1), a), _dot(_row(turn, 2), a)


@_inlined
def _to_body(turn, a):
    return _to_world(turn.T, a)


@_inlined
def _turn(out, base, axis, angle):
    """Write `base` turned by an angle about an axis of its own (Rodrigues), (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    for n in range(3):
        row = _row(base, n)
        along, across = (1.0 - c) * _dot(row, axis), _cross(row, axis)
        for k in range(3):
            out[n, k] = c * row[k] + along * axis[k] + s * across[k]


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
