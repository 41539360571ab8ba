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


@numba.njit(cache=True)
def accelerate(q, qd, torque, mass, gravity, out):
    """Write the accelerations (J,) that `torque` (J,) gives; J is one or two."""
    a, b = np.cos(q[0]), np.sin(q[0])
    if len(q) == 1:
        g = gravity[0]
        out[0] = (torque[0] - g[0] - a * g[3] - b * g[6]) / mass[0, 0]
        return
    c, s = np.cos(q[1]), np.sin(q[1])
    c2, s2 = c * c - s * s, 2.0 * c * s
    m11 = mass[0, 0] + c * mass[0, 1] + s * mass[0, 2] + c2 * mass[0, 3] + s2 * mass[0, 4]
    m12 = mass[1, 0] + c * mass[1, 1] + s * mass[1, 2] + c2 * mass[1, 3] + s2 * mass[1, 4]
    m22 = mass[2, 0]
    d11 = c * mass[0, 2] - s * mass[0, 1] + 2.0 * (c2 * mass[0, 4] - s2 * mass[0, 3])
    d12 = c * mass[1, 2] - s * mass[1, 1] + 2.0 * (c2 * mass[1, 4] - s2 * mass[1, 3])
    t0 = torque[0] - qd[1] * (d11 * qd[0] + d12 * qd[1])
    t1 = torque[1] + 0.5 * d11 * qd[0] * qd[0]
    for j in range(2):
        g = gravity[j]
        pull = g[0] + c * g[1] + s * g[2] + a * (g[3] + c * g[4] + s * g[5])
        pull += b * (g[6] + c * g[7] + s * g[8])
        if j == 0:
            t0 -= pull
        else:
            t1 -= pull
    determinant = m11 * m22 - m12 * m12
    out[0] = (m22 * t0 - m12 * t1) / determinant
    out[1] = (m11 * t1 - m12 * t0) / determinant
