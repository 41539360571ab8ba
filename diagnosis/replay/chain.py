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

from backends.spec import Body, Joint, Spec
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
    """Driven joint that moves each body, shape (B,); -1 where it is fixed."""
    course: Array
    """The body's position on its joint by the driven joint's: a polynomial, the lowest coefficient
    first, shape (B, 5); 0 1 0 0 0 of the driven joint itself."""
    follows: Array
    """Whether a body follows its driven joint by another joint, shape (B,)."""
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
    carried: Array
    """Share of each weight that is carried beside the drives, shape (B,)."""
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
        if _fixed(body) and body.parent in offset:
            offset[body.name] = _plus(offset[body.parent], body.origin_m)
        else:
            bodies += [body, _load(body)] if body.payload else [body]
    names, joints = [b.name for b in bodies], spec.hand.joint_names
    rows = tuple(
        (
            -1 if b.parent in offset else names.index(str(b.parent)),
            FIXED if _fixed(b) else (SLIDE if b.joint.slides else HINGE),
            -1 if _fixed(b) else joints.index(b.joint.follows or b.joint.name),
            (*b.joint.course, *(0.0,) * 5)[:5] if b.joint.follows else (0.0, 1.0, 0.0, 0.0, 0.0),
            b.joint.follows is not None,
            _plus(offset.get(b.parent, (0.0, 0.0, 0.0)), b.origin_m),
            b.joint.axis,
            b.mass_kg,
            b.com_m,
            (b.inertia_kgm2, b.products_kgm2),
            b.carried,
        )
        for b in bodies
    )
    return _chain(rows, spec.gravity_m_s2)


def _load(body: Body) -> Body:
    """What a body holds at its end, which nobody carries."""
    name, nowhere = f"{body.name} load", (0.0, 0.0, 0.0)
    return Body(
        name=name,
        parent=body.name,
        origin_m=body.end_m,
        joint=Joint(name=name, axis=body.joint.axis, range_rad=(0.0, 0.0), drive=None),
        mass_kg=body.payload * body.mass_kg,
        com_m=nowhere,
        inertia_kgm2=nowhere,
    )


def _fixed(body: Body) -> bool:
    return body.joint.drive is None and body.joint.follows is None


@lru_cache(maxsize=256)
def _chain(rows: tuple[tuple, ...], gravity_m_s2: tuple[float, ...]) -> Chain:
    """A row per body. It is cached, because most candidate worlds differ only in their drives."""
    parent, kind, column, course, follows, *place, mass, com, inertia, carried = zip(
        *rows, strict=True
    )
    origin, axis = place
    return Chain(
        parent=np.array(parent),
        kind=np.array(kind),
        column=np.array(column),
        course=np.array(course, dtype=float),
        follows=np.array(follows),
        origin_m=np.array(origin, dtype=float),
        axis=np.array(axis, dtype=float),
        mass_kg=np.array(mass, dtype=float),
        com_m=np.array(com, dtype=float),
        inertia_kgm2=np.array([_tensor(*one) for one in inertia]),
        carried=np.array(carried, dtype=float),
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
origin, centre of mass, force and moment about the centre, and two scratch rows."""


@numba.njit(cache=True)
def workspace(bodies, joints):
    """Arrays for the intermediate results of `dynamics`; the last body is the world."""
    turn = np.zeros((bodies + 1, 3, 3))
    for i in range(3):
        turn[bodies, i, i] = 1.0
    return turn, np.zeros((bodies + 1, 10, 3)), np.zeros((joints, 3, 3))


@numba.njit(cache=True)
def dynamics(q, qd, chain, work, mass, bias):
    """Write the mass matrix (J, J) [kg m^2] and the bias torques (J,) [Nm]; slides: kg and N.

    An empty mass matrix is left out.
    """
    parent, kind, column, course, _, origin, axis, mass_kg, com, inertia, carried, gravity = chain
    turn, rows, columns = work
    world = len(parent)
    mass[:] = 0.0
    bias[:] = 0.0
    for b in range(world):
        above = parent[b] if parent[b] >= 0 else world
        j, at = column[b], (0.0, 0.0, 0.0)
        if j >= 0:
            at = _followed(course[b], q[j], qd[j])
        _move(rows[above], rows[b], turn[above], turn[b], kind[b], origin[b], axis[b], at)
        _resist(rows[b], turn[b], mass_kg[b], com[b], inertia[b], 1.0 - carried[b], gravity)
        if len(mass):
            _add_mass(b, q, chain, work, mass)
    for b in range(world - 1, -1, -1):
        body, j = rows[b], column[b]
        _about_origin(body)
        if j >= 0:
            load = body[_FORCE] if kind[b] == 1 else body[_MOMENT]
            bias[j] += _followed(course[b], q[j], 1.0)[1] * _dot(body[_AXIS], load)
        if parent[b] >= 0:
            _carry(body, rows[parent[b]])


@numba.njit(cache=True)
def _add_mass(b, q, chain, work, mass):
    """Add one body's part of the mass matrix, by the velocities that joints give its centre."""
    parent, kind, column, course, _, _, _, mass_kg, _, inertia, _, _ = chain
    turn, rows, columns = work
    columns[:] = 0.0
    carrier = b
    while carrier >= 0:
        k = column[carrier]
        if k >= 0:
            rate = _followed(course[carrier], q[k], 1.0)[1]
            _column(rows[b], rows[carrier], turn[b], kind[carrier], rate, columns[k])
        carrier = parent[carrier]
    for k in range(len(mass)):
        if not columns[k].any():
            continue
        for n in range(k + 1):
            part = mass_kg[b] * _dot(columns[k, 0], columns[n, 0])
            for i in range(3):
                part += columns[k, 2, i] * _dot(inertia[b, i], columns[n, 2])
            mass[k, n] += part
            mass[n, k] += part if n != k else 0.0


@numba.njit(cache=True)
def _about_origin(body):
    """Turn the moment about a body's centre into that about its joint."""
    for i in range(3):
        body[_ARM, i] = body[_CENTER, i] - body[_AT, i]
    _cross(body[_ARM], body[_FORCE], body[_TEMP])
    for i in range(3):
        body[_MOMENT, i] += body[_TEMP, i]


@numba.njit(cache=True)
def _carry(body, above):
    """Add a body's force and moment, about its joint, to those about its parent's centre."""
    for i in range(3):
        body[_ARM, i] = body[_AT, i] - above[_CENTER, i]
    _cross(body[_ARM], body[_FORCE], body[_TEMP])
    for i in range(3):
        above[_FORCE, i] += body[_FORCE, i]
        above[_MOMENT, i] += body[_MOMENT, i] + body[_TEMP, i]


@numba.njit(cache=True)
def _followed(course, q, qd):
    """Position, speed, and acceleration at none of the driven joint, of what follows it."""
    at = course[0] + q * (course[1] + q * (course[2] + q * (course[3] + q * course[4])))
    rate = course[1] + q * (2.0 * course[2] + q * (3.0 * course[3] + q * 4.0 * course[4]))
    bend = 2.0 * course[2] + q * (6.0 * course[3] + q * 12.0 * course[4])
    return at, rate * qd, bend * qd * qd


@numba.njit(cache=True)
def _move(above, body, turn_above, turn, kind, origin, axis, at):
    """Place a body and its velocities and accelerations at zero joint acceleration."""
    q, qd, qdd = at
    _turn(turn_above, axis, body[_AXIS])
    _turn(turn_above, origin, body[_ARM])
    if kind == 1:
        for i in range(3):
            body[_ARM, i] += body[_AXIS, i] * q
    _cross(above[_OMEGA], body[_ARM], body[_TEMP])
    _cross(above[_OMEGA], body[_TEMP], body[_ACC])
    _cross(above[_ALPHA], body[_ARM], body[_TEMP])
    for i in range(3):
        body[_AT, i] = above[_AT, i] + body[_ARM, i]
        body[_ACC, i] += above[_ACC, i] + body[_TEMP, i]
        body[_OMEGA, i], body[_ALPHA, i] = above[_OMEGA, i], above[_ALPHA, i]
    if kind == 0:
        _hinge(turn_above, axis, q, turn)
        _cross(above[_OMEGA], body[_AXIS], body[_TEMP])
        for i in range(3):
            body[_OMEGA, i] += body[_AXIS, i] * qd
            body[_ALPHA, i] += body[_TEMP, i] * qd + body[_AXIS, i] * qdd
        return
    for i in range(3):
        for k in range(3):
            turn[i, k] = turn_above[i, k]
    if kind == 1:
        _cross(above[_OMEGA], body[_AXIS], body[_TEMP])
        for i in range(3):
            body[_ACC, i] += 2.0 * qd * body[_TEMP, i] + body[_AXIS, i] * qdd


@numba.njit(cache=True)
def _resist(body, turn, mass_kg, com, inertia, weight, gravity):
    """Write the force and moment at a body's centre that its motion and weight require."""
    _turn(turn, com, body[_ARM])
    _cross(body[_OMEGA], body[_ARM], body[_TEMP])
    _cross(body[_OMEGA], body[_TEMP], body[_FORCE])
    _cross(body[_ALPHA], body[_ARM], body[_TEMP])
    for i in range(3):
        body[_CENTER, i] = body[_AT, i] + body[_ARM, i]
        acceleration = body[_ACC, i] + body[_FORCE, i] + body[_TEMP, i]
        body[_FORCE, i] = mass_kg * (acceleration - weight * gravity[i])
    _turn_back(turn, body[_OMEGA], body[_TEMP])
    _turn(inertia, body[_TEMP], body[_ARM])
    _cross(body[_TEMP], body[_ARM], body[_MOMENT])
    _turn_back(turn, body[_ALPHA], body[_TEMP])
    _turn(inertia, body[_TEMP], body[_ARM])
    for i in range(3):
        body[_TEMP, i] = body[_MOMENT, i] + body[_ARM, i]
    _turn(turn, body[_TEMP], body[_MOMENT])


@numba.njit(cache=True)
def _column(body, carrier, turn, kind, rate, column):
    """Add a joint's effect on a body: velocity of its centre, and rotation in both frames."""
    hinge = kind != 1
    for i in range(3):
        body[_ARM, i] = body[_CENTER, i] - carrier[_AT, i]
        body[_TEMP, i] = carrier[_AXIS, i]
    if hinge:
        _cross(carrier[_AXIS], body[_ARM], body[_TEMP])
    for i in range(3):
        column[0, i] += rate * body[_TEMP, i]
        column[1, i] += rate * carrier[_AXIS, i] if hinge else 0.0
    _turn_back(turn, column[1], column[2])
