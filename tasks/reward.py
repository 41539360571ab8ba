"""The paper's reward and the errors of a step, and the desired axis: one pass over the worlds.

    r = alive - w_axis |u - u_d| - w_end (|e_low| + |e_top|) - w_force sum |f|

u is the stick's axis, u_d the desired one, e_low and e_top the distances [m] of the stick's ends
from those of a stick at the drawn point along u_d, f the forces on the fingertips [N].
"""

import math

import numba
import numpy as np

from backends.state import Array, State

ALIVE, AXIS_WEIGHT, END_WEIGHT, FORCE_WEIGHT = 0.5, 1.5, 2.0, 0.005
"""The paper's reward: [C, w0, w1 per m, w2 per N]."""


@numba.njit(cache=True)
def _axes(offset, lever, out):
    for n in range(len(offset)):
        x, y = -offset[n, 0] / lever[n], -offset[n, 1] / lever[n]
        out[n, 0], out[n, 1], out[n, 2] = x, y, math.sqrt(1 - (x * x + y * y))


def desired_axis(offset_m: Array, lever_m: Array) -> Array:
    """Unit vectors (N, 3) from the reference points to the pivot; levers (N,) are end to pivot."""
    axis = np.empty((len(offset_m), 3))
    _axes(offset_m, lever_m, axis)
    return axis


@numba.njit(cache=True)
def _judge(pos, quat, force, desired, grip, lever, half, out):
    for n in range(len(pos)):
        w, x, y, z = quat[n, 0], quat[n, 1], quat[n, 2], quat[n, 3]
        axis = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
        low, top, turned, press = 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            lower = pos[n, i] - half[n] * axis[i]
            drawn = grip[i] - lever[n] * desired[n, i]
            length = 2 * half[n]
            low += (lower - drawn) ** 2
            top += ((lower + length * axis[i]) - (drawn + length * desired[n, i])) ** 2
            turned += (axis[i] - desired[n, i]) ** 2
        for f in range(force.shape[1]):
            a, b, c = force[n, f, 0], force[n, f, 1], force[n, f, 2]
            press += math.sqrt(a * a + b * b + c * c)
        low, top, turned = math.sqrt(low), math.sqrt(top), math.sqrt(turned)
        reward = ALIVE - AXIS_WEIGHT * turned - END_WEIGHT * (low + top)
        out[0, n] = reward - FORCE_WEIGHT * press
        out[1, n], out[2, n] = low, 2 * math.asin(min(turned / 2, 1.0))


def judge(
    state: State, desired: Array, grip_m: Array, lever_m: Array, half_m: Array
) -> tuple[Array, Array, Array]:
    """Rewards, errors of the lower end [m] and of the axis [rad], each (N,).

    The stick's grip is `lever_m` from its lower end and to be at `grip_m` (3,); it is 2 `half_m`
    long.
    """
    out = np.empty((3, len(desired)))
    pose = state.stick_pos_m, state.stick_quat_wxyz
    _judge(*pose, state.contact_force_n, desired, grip_m, lever_m, half_m, out)
    return out[0], out[1], out[2]
