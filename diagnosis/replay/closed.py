"""The dynamics of one or two joints in closed form: exact at every tick, without the recursion.

For hinges in a chain the mass matrix is a trigonometric polynomial of degree two in the second
angle, and gravity's torques are of degree one in each angle. Their values at a few poses give the
coefficients exactly; the other velocity terms follow from the mass matrix (Christoffel symbols:
Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, chapter 7). Of slides alone
masses and gravity are constant.
"""

import numba
import numpy as np

from backends.spec import Spec
from backends.state import Array

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


@numba.njit(cache=True, error_model="numpy")
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
