"""A plane chain of one or two links in closed form, by Lagrange."""

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind.plant import Limb


def geometry(limb: Limb) -> tuple[Array, Array]:
    """Links (2, 7) of a limb in its plane (mass, centre, length, inertia, weight), gravity (2,).

    The weight, as a mass, is what nothing carries beside the drives.

    Raises ValueError for anything but a plane chain of one or two links.
    """
    axis = np.array(limb.bodies[0].joint.axis)
    if len(limb.bodies) > 2 or any(body.joint.axis != tuple(axis) for body in limb.bodies):
        raise ValueError("this plant supports only limbs of one or two parallel hinges")
    u = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.5 else np.array([0.0, 1.0, 0.0])
    u = u - (u @ axis) * axis
    plane = np.stack([u / np.linalg.norm(u), np.cross(axis, u / np.linalg.norm(u))])
    links = np.zeros((2, 7))
    for i, body in enumerate(limb.bodies):
        links[i, 0], links[i, 5] = body.mass_kg, float(axis**2 @ np.array(body.inertia_kgm2))
        links[i, 6] = (1.0 - body.carried) * body.mass_kg
        links[i, 1:3] = plane @ np.array(body.com_m)
        if i > 0:
            links[0, 3:5] = plane @ np.array(body.origin_m)
    return links, plane @ np.array(limb.gravity_m_s2)


@numba.njit(cache=True)
def move(q, qd, torque, links, pull, acceleration, tick_s):
    """Move a plane chain by a step of semi-implicit Euler, in place."""
    fall(q, qd, torque, links, pull, acceleration)
    for j in range(len(q)):
        qd[j] += tick_s * acceleration[j]
        q[j] += tick_s * qd[j]


@numba.njit(cache=True)
def fall(q, qd, torque, links, pull, out):
    """Write the accelerations of a plane chain of one or two links."""
    m1, m2, w1, w2 = links[0, 0], links[1, 0], links[0, 6], links[1, 6]
    c1, l1, c2 = links[0, 1:3], links[0, 3:5], links[1, 1:3]
    a, b = np.cos(q[0]), np.sin(q[0])
    g0, g1 = a * pull[0] + b * pull[1], a * pull[1] - b * pull[0]  # gravity seen from link 1
    own = links[0, 5] + m1 * (c1[0] ** 2 + c1[1] ** 2)
    weight1 = w1 * (c1[0] * g1 - c1[1] * g0)
    if len(q) == 1:
        out[0] = (torque[0] + weight1) / own
        return
    c, s = np.cos(q[1]), np.sin(q[1])
    x, y = c * c2[0] - s * c2[1], s * c2[0] + c * c2[1]
    m22 = links[1, 5] + m2 * (c2[0] ** 2 + c2[1] ** 2)
    m12 = m22 + m2 * (l1[0] * x + l1[1] * y)
    m11 = own + m2 * (l1[0] ** 2 + l1[1] ** 2) + 2 * m12 - m22
    h = m2 * (l1[1] * x - l1[0] * y)
    weight2 = w2 * (x * g1 - y * g0)
    weight1 += weight2 + w2 * (l1[0] * g1 - l1[1] * g0)
    t1 = torque[0] + weight1 - h * qd[1] * (2 * qd[0] + qd[1])
    t2 = torque[1] + weight2 + h * qd[0] ** 2
    det = m11 * m22 - m12 * m12
    out[0] = (m22 * t1 - m12 * t2) / det
    out[1] = (m11 * t2 - m12 * t1) / det
