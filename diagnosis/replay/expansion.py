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
SMALL_RAD = 0.03
"""Up to this move, the error of `turned_a_little` is below rounding: at 1 kHz up to 30 rad/s."""


@numba.njit(cache=True)
def expand(chain):
    """Coefficients (33,): of m11, m12, m22 in (1, c, s, c2, s2), then gravity's (2, 9).

    Empty where the closed form does not hold: more than two joints, a slide and a hinge, or joints
    that follow others.
    """
    joints = chain[2].max() + 1
    slides = (chain[1] == SLIDE).sum()
    if joints > 2 or 0 < slides < joints or chain[4].any():
        return np.zeros(0)
    work = workspace(len(chain[0]), joints)
    q, still = np.zeros(joints), np.zeros(joints)
    m, bias = np.zeros((joints, joints)), np.zeros(joints)
    mass, gravity = np.zeros((3, 5)), np.zeros((2, 9))
    if slides == joints:
        dynamics(q, still, chain, work, m, bias)
        mass[0, 0], mass[1, 0], mass[2, 0] = m[0, 0], m[0, joints - 1], m[joints - 1, joints - 1]
        gravity[:joints, 0] = bias
        return np.concatenate((mass.ravel(), gravity.ravel()))
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
    return np.concatenate((mass.ravel(), gravity.ravel()))


@numba.njit(cache=True, error_model="numpy")
def wave(q):
    """Cosine and sine of an angle."""
    return np.cos(q), np.sin(q)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def turned_a_little(own, move):
    """Cosine and sine `own` of an angle once it has made a small move.

    By the first terms of its series and the addition theorem, to the last digit: cosines would take
    a sixth of a tick's time.
    """
    square = move * move
    c = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    s = move * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return own[0] * c - own[1] * s, own[1] * c + own[0] * s


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def accelerate_one(own, torque, x, at, step):
    """The acceleration of a lone joint; `own` as from `wave`.

    The coefficients of `expand` are `x[at]`, `x[at + step]` and so on.
    """
    g = at + 15 * step
    pull = own[0] * x[g + 3 * step], own[1] * x[g + 6 * step]
    return (torque - x[g] - pull[0] - pull[1]) / x[at]


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def accelerate_two(first, second, qd1, qd2, torque1, torque2, x, at, step):
    """The accelerations of two joints, see `accelerate_one`."""
    (a, b), (c, s) = first, second
    c2, s2 = c * c - s * s, 2.0 * c * s
    m, g, h = at + 5 * step, at + 15 * step, at + 24 * step
    m11 = x[at] + c * x[at + step] + s * x[at + 2 * step]
    m11 = m11 + c2 * x[at + 3 * step] + s2 * x[at + 4 * step]
    m12 = x[m] + c * x[m + step] + s * x[m + 2 * step]
    m12 = m12 + c2 * x[m + 3 * step] + s2 * x[m + 4 * step]
    m22 = x[at + 10 * step]
    d11 = c * x[at + 2 * step] - s * x[at + step]
    d11 += 2.0 * (c2 * x[at + 4 * step] - s2 * x[at + 3 * step])
    d12 = c * x[m + 2 * step] - s * x[m + step]
    d12 += 2.0 * (c2 * x[m + 4 * step] - s2 * x[m + 3 * step])
    t1 = torque1 - qd2 * (d11 * qd1 + d12 * qd2)
    t2 = torque2 + 0.5 * d11 * qd1 * qd1
    t1 -= _pull(a, b, c, s, x, g, step)
    t2 -= _pull(a, b, c, s, x, h, step)
    part = 1.0 / (m11 * m22 - m12 * m12)
    return (m22 * t1 - m12 * t2) * part, (m11 * t2 - m12 * t1) * part


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _pull(a, b, c, s, x, g, step):
    """Gravity's torque on a joint."""
    pull = x[g] + c * x[g + step] + s * x[g + 2 * step]
    pull += a * (x[g + 3 * step] + c * x[g + 4 * step] + s * x[g + 5 * step])
    return pull + b * (x[g + 6 * step] + c * x[g + 7 * step] + s * x[g + 8 * step])
