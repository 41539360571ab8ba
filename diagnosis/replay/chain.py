"""Rigid dynamics of a hand or a user's robot in compiled numpy, without contacts.

    M(q) q'' + bias(q, q') = tau

Engines simulate the same equations, and parity tests check that. This code handles only joints, so
a candidate world costs a microsecond per tick and thousands can be tried.

M = sum of m Jv' Jv + Jw' I Jw over the bodies; the bias comes from the recursive Newton-Euler
algorithm at zero acceleration (Featherstone, Rigid Body Dynamics Algorithms, 2008). All vectors are
in the world frame.
"""

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import numba
import numpy as np

from backends.spec import Body, Spec
from backends.state import Array

HINGE, SLIDE, FIXED = 0, 1, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """B bodies in kinematic order, J of them driven; frames parallel to the world's at zero.

    Equal bodies are one object.
    """

    parent: Array
    """Index of the carrying body, shape (B,); -1: the world."""
    kind: Array
    """HINGE, SLIDE or FIXED, shape (B,)."""
    column: Array
    """Driven joint of each body, shape (B,); -1 where it is fixed."""
    origin_m: Array
    """Joint position in the parent's frame [m], shape (B, 3)."""
    axis: Array
    """Unit joint axis, shape (B, 3)."""
    mass_kg: Array
    """Masses [kg], shape (B,)."""
    com_m: Array
    """Centres of mass in the body's frame [m], shape (B, 3)."""
    inertia_kgm2: Array
    """Inertia tensors about the centres of mass [kg m^2], shape (B, 3, 3)."""
    gravity_m_s2: Array
    """Gravity [m/s^2], shape (3,)."""

    @cached_property
    def numbers(self) -> tuple[Array, ...]:
        """All fields in order, for compiled code."""
        return tuple(getattr(self, field.name) for field in fields(self))


def chain(spec: Spec) -> Chain:
    """The bodies of a spec's hand; a body fixed to the world only shifts those it carries."""
    offset: dict[str | None, tuple[float, ...]] = {None: (0.0, 0.0, 0.0)}
    bodies: list[Body] = []
    for body in spec.hand.bodies:
        if body.joint.drive is None and body.parent in offset:
            offset[body.name] = _plus(offset[body.parent], body.origin_m)
        else:
            bodies.append(body)
    names, joints = [b.name for b in bodies], spec.hand.joint_names
    rows = tuple(
        (
            -1 if b.parent in offset else names.index(str(b.parent)),
            (SLIDE if b.joint.slides else HINGE) if b.joint.drive else FIXED,
            joints.index(b.joint.name) if b.joint.drive else -1,
            _plus(offset.get(b.parent, (0.0, 0.0, 0.0)), b.origin_m),
            b.joint.axis,
            b.mass_kg,
            b.com_m,
            (b.inertia_kgm2, b.products_kgm2),
        )
        for b in bodies
    )
    return _chain(rows, spec.gravity_m_s2)


@lru_cache(maxsize=256)
def _chain(rows: tuple[tuple, ...], gravity_m_s2: tuple[float, ...]) -> Chain:
    """A row per body. It is cached, because most candidate worlds differ only in their drives."""
    parent, kind, column, origin, axis, mass, com, inertia = zip(*rows, strict=True)
    return Chain(
        parent=np.array(parent),
        kind=np.array(kind),
        column=np.array(column),
        origin_m=np.array(origin, dtype=float),
        axis=np.array(axis, dtype=float),
        mass_kg=np.array(mass, dtype=float),
        com_m=np.array(com, dtype=float),
        inertia_kgm2=np.array([_tensor(*one) for one in inertia]),
        gravity_m_s2=np.array(gravity_m_s2, dtype=float),
    )


def _plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _tensor(moments: tuple[float, ...], products: tuple[float, ...]) -> Array:
    (x, y, z), (xy, xz, yz) = moments, products
    return np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]], dtype=float)


@numba.njit(cache=True)
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _turn(r, v, out):
    for i in range(3):
        out[i] = r[i, 0] * v[0] + r[i, 1] * v[1] + r[i, 2] * v[2]


@numba.njit(cache=True)
def _turn_back(r, v, out):
    for i in range(3):
        out[i] = r[0, i] * v[0] + r[1, i] * v[1] + r[2, i] * v[2]


@numba.njit(cache=True)
def _hinge(parent, axis, angle, out):
    """Turn the rotation `parent` about an axis in its frame (Rodrigues' formula)."""
    x, y, z = axis[0], axis[1], axis[2]
    c, s = np.cos(angle), np.sin(angle)
    t = 1.0 - c
    r = (
        (t * x * x + c, t * x * y - s * z, t * x * z + s * y),
        (t * x * y + s * z, t * y * y + c, t * y * z - s * x),
        (t * x * z - s * y, t * y * z + s * x, t * z * z + c),
    )
    for i in range(3):
        for j in range(3):
            out[i, j] = parent[i, 0] * r[0][j] + parent[i, 1] * r[1][j] + parent[i, 2] * r[2][j]


_AT, _AXIS, _OMEGA, _ALPHA, _ACC, _CENTER, _FORCE, _MOMENT, _ARM, _TEMP = range(10)
"""Rows of a body's vectors: origin, joint axis, angular velocity and its rate, acceleration of the
origin, centre of mass, inertial force and moment about the centre, and two scratch rows."""


@numba.njit(cache=True)
def workspace(bodies, joints):
    """Arrays for the intermediate results of `dynamics`; the last body is the world."""
    turn = np.zeros((bodies + 1, 3, 3))
    for i in range(3):
        turn[bodies, i, i] = 1.0
    return turn, np.zeros((bodies + 1, 10, 3)), np.zeros((joints, 3, 3))


@numba.njit(cache=True)
def dynamics(q, qd, chain, work, mass, bias):
    """Write the mass matrix (J, J) [kg m^2] and the bias torques (J,) [Nm]; slides: kg and N."""
    parent, kind, column, origin, axis, mass_kg, com, inertia, gravity = chain
    turn, rows, columns = work
    world = len(parent)
    mass[:] = 0.0
    bias[:] = 0.0
    for b in range(world):
        above = parent[b] if parent[b] >= 0 else world
        j = column[b]
        _move(rows[above], rows[b], turn[above], turn[b], kind[b], origin[b], axis[b], j, q, qd)
        _resist(rows[b], turn[b], mass_kg[b], com[b], inertia[b], gravity)
        carrier = b
        while carrier >= 0:
            if column[carrier] >= 0:
                _column(rows[b], rows[carrier], turn[b], kind[carrier], columns[column[carrier]])
            carrier = parent[carrier]
        carrier = b
        while carrier >= 0:
            k = column[carrier]
            if k >= 0:
                bias[k] += _dot(columns[k, 0], rows[b, _FORCE])
                bias[k] += _dot(columns[k, 1], rows[b, _MOMENT])
                _couple(b, parent, column, mass_kg[b], inertia[b], k, columns, mass[k])
            carrier = parent[carrier]


@numba.njit(cache=True)
def _move(above, body, turn_above, turn, kind, origin, axis, j, q, qd):
    """Place a body and its velocities and accelerations at zero joint acceleration."""
    _turn(turn_above, axis, body[_AXIS])
    _turn(turn_above, origin, body[_ARM])
    if kind == 1:
        for i in range(3):
            body[_ARM, i] += body[_AXIS, i] * q[j]
    _cross(above[_OMEGA], body[_ARM], body[_TEMP])
    _cross(above[_OMEGA], body[_TEMP], body[_ACC])
    _cross(above[_ALPHA], body[_ARM], body[_TEMP])
    for i in range(3):
        body[_AT, i] = above[_AT, i] + body[_ARM, i]
        body[_ACC, i] += above[_ACC, i] + body[_TEMP, i]
        body[_OMEGA, i], body[_ALPHA, i] = above[_OMEGA, i], above[_ALPHA, i]
    if kind == 0:
        _hinge(turn_above, axis, q[j], turn)
        _cross(above[_OMEGA], body[_AXIS], body[_TEMP])
        for i in range(3):
            body[_OMEGA, i] += body[_AXIS, i] * qd[j]
            body[_ALPHA, i] += body[_TEMP, i] * qd[j]
        return
    for i in range(3):
        for k in range(3):
            turn[i, k] = turn_above[i, k]
    if kind == 1:
        _cross(above[_OMEGA], body[_AXIS], body[_TEMP])
        for i in range(3):
            body[_ACC, i] += 2.0 * qd[j] * body[_TEMP, i]


@numba.njit(cache=True)
def _resist(body, turn, mass_kg, com, inertia, gravity):
    """Write the force and moment at a body's centre that its motion and weight require."""
    _turn(turn, com, body[_ARM])
    _cross(body[_OMEGA], body[_ARM], body[_TEMP])
    _cross(body[_OMEGA], body[_TEMP], body[_FORCE])
    _cross(body[_ALPHA], body[_ARM], body[_TEMP])
    for i in range(3):
        body[_CENTER, i] = body[_AT, i] + body[_ARM, i]
        acceleration = body[_ACC, i] + body[_FORCE, i] + body[_TEMP, i]
        body[_FORCE, i] = mass_kg * (acceleration - gravity[i])
    _turn_back(turn, body[_OMEGA], body[_TEMP])
    _turn(inertia, body[_TEMP], body[_ARM])
    _cross(body[_TEMP], body[_ARM], body[_MOMENT])
    _turn_back(turn, body[_ALPHA], body[_TEMP])
    _turn(inertia, body[_TEMP], body[_ARM])
    for i in range(3):
        body[_TEMP, i] = body[_MOMENT, i] + body[_ARM, i]
    _turn(turn, body[_TEMP], body[_MOMENT])


@numba.njit(cache=True)
def _column(body, carrier, turn, kind, column):
    """Effect of a joint on a body: velocity of its centre, and rotation in both frames."""
    hinge = kind != 1
    for i in range(3):
        body[_ARM, i] = body[_CENTER, i] - carrier[_AT, i]
        column[0, i] = carrier[_AXIS, i]
        column[1, i] = carrier[_AXIS, i] if hinge else 0.0
    if hinge:
        _cross(carrier[_AXIS], body[_ARM], column[0])
    _turn_back(turn, column[1], column[2])


@numba.njit(cache=True)
def _couple(b, parent, column, mass_kg, inertia, k, columns, out):
    """Add a body's share of row `k` of the mass matrix."""
    while b >= 0:
        j = column[b]
        if j >= 0:
            out[j] += mass_kg * _dot(columns[k, 0], columns[j, 0])
            for i in range(3):
                out[j] += columns[k, 2, i] * _dot(inertia[i], columns[j, 2])
        b = parent[b]
