"""The dynamics of one or two joints in closed form, ten times faster than the recursion.

For hinges in a chain the mass matrix is a trigonometric polynomial of degree two in the second
angle, and gravity's torques are of degree one in each angle. Sampling `dynamics` at a few angles
gives their coefficients exactly; the other velocity terms follow from the mass matrix (Christoffel
symbols: Spong, Hutchinson and Vidyasagar, Robot Modeling and Control, 2006, chapter 7). Of slides
alone masses and gravity are constant.
"""

import numba
import numpy as np

from diagnosis.replay.chain import SLIDE, dynamics, workspace

_POINTS = 5
"""Angles at which a polynomial of degree two is sampled."""
_SMALL = 0.03
"""Moves up to here [rad] leave less than rounding in `turned`: at 1 kHz up to 30 rad/s."""


@numba.njit(cache=True)
def expand(chain):
    """Coefficients: mass (3, 5) of m11, m12, m22 in (1, c, s, c2, s2) and gravity (2, 9).

    Empty arrays where the closed form does not hold: more than two joints, a slide and a hinge.
    """
    joints = chain[2].max() + 1
    slides = (chain[1] == SLIDE).sum()
    if joints > 2 or 0 < slides < joints:
        return np.zeros((0, 5)), np.zeros((0, 9))
    work = workspace(len(chain[0]), joints)
    q, still = np.zeros(joints), np.zeros(joints)
    m, bias = np.zeros((joints, joints)), np.zeros(joints)
    mass, gravity = np.zeros((3, 5)), np.zeros((2, 9))
    if slides == joints:
        dynamics(q, still, chain, work, m, bias)
        mass[0, 0], mass[1, 0], mass[2, 0] = m[0, 0], m[0, joints - 1], m[joints - 1, joints - 1]
        gravity[:joints, 0] = bias
        return mass, gravity
    for k in range(_POINTS):
        angle = 2 * np.pi * k / _POINTS
        q[joints - 1] = angle
        dynamics(q, still, chain, work, m, bias)
        values = (m[0, 0], m[0, joints - 1], m[joints - 1, joints - 1])
        waves = (1.0, np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle))
        for i in range(3):
            for w in range(5):
                mass[i, w] += values[i] * waves[w] * (1.0 if w == 0 else 2.0) / _POINTS
    for first in range(3):
        for second in range(3):
            a, b = 2 * np.pi * first / 3, 2 * np.pi * second / 3
            q[0] = a
            if joints == 2:
                q[1] = b
            dynamics(q, still, chain, work, m, bias)
            waves_a, waves_b = (1.0, np.cos(a), np.sin(a)), (1.0, np.cos(b), np.sin(b))
            for j in range(joints):
                for i in range(9):
                    share = (1.0 if i // 3 == 0 else 2.0) * (1.0 if i % 3 == 0 else 2.0) / 9
                    gravity[j, i] += bias[j] * waves_a[i // 3] * waves_b[i % 3] * share
    return mass, gravity


@numba.njit(cache=True, error_model="numpy")
def wave(q):
    """Cosine and sine of an angle."""
    return np.cos(q), np.sin(q)


@numba.njit(cache=True, error_model="numpy")
def turned(own, q, move):
    """Cosine and sine `own` of an angle once it has moved to `q`.

    Of a small move by the first terms of its series and the addition theorem, to the last digit:
    cosines would take a sixth of a tick's time.
    """
    if abs(move) > _SMALL:
        return wave(q)
    square = move * move
    c = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    s = move * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return own[0] * c - own[1] * s, own[1] * c + own[0] * s


@numba.njit(cache=True, error_model="numpy")
def accelerate_one(own, torque, mass, gravity):
    """The acceleration of a lone joint; `own` as from `wave`."""
    g = own[0] * gravity[0, 3], own[1] * gravity[0, 6]
    return (torque - gravity[0, 0] - g[0] - g[1]) / mass[0, 0]


@numba.njit(cache=True, error_model="numpy")
def accelerate_two(first, second, qd1, qd2, torque1, torque2, mass, g):
    """The accelerations of two joints; `first` and `second` as from `wave`."""
    (a, b), (c, s) = first, second
    c2, s2 = c * c - s * s, 2.0 * c * s
    m11 = mass[0, 0] + c * mass[0, 1] + s * mass[0, 2] + c2 * mass[0, 3] + s2 * mass[0, 4]
    m12 = mass[1, 0] + c * mass[1, 1] + s * mass[1, 2] + c2 * mass[1, 3] + s2 * mass[1, 4]
    m22 = mass[2, 0]
    d11 = c * mass[0, 2] - s * mass[0, 1] + 2.0 * (c2 * mass[0, 4] - s2 * mass[0, 3])
    d12 = c * mass[1, 2] - s * mass[1, 1] + 2.0 * (c2 * mass[1, 4] - s2 * mass[1, 3])
    t1 = torque1 - qd2 * (d11 * qd1 + d12 * qd2)
    t2 = torque2 + 0.5 * d11 * qd1 * qd1
    pull = g[0, 0] + c * g[0, 1] + s * g[0, 2] + a * (g[0, 3] + c * g[0, 4] + s * g[0, 5])
    t1 -= pull + b * (g[0, 6] + c * g[0, 7] + s * g[0, 8])
    pull = g[1, 0] + c * g[1, 1] + s * g[1, 2] + a * (g[1, 3] + c * g[1, 4] + s * g[1, 5])
    t2 -= pull + b * (g[1, 6] + c * g[1, 7] + s * g[1, 8])
    part = 1.0 / (m11 * m22 - m12 * m12)
    return (m22 * t1 - m12 * t2) * part, (m11 * t2 - m12 * t1) * part
