"""Run the drives as MuJoCo's control callback, so that a policy period is one call to the engine.

MuJoCo calls the callback in every step, on its own threads, with a model and its data. The user
data of the simulation holds the number of the world. Only public functions of MuJoCo are used.
"""

import mujoco
import numba
import numpy as np
from numba.core import types

from backends._calls import DriveCallArgs, array_at, find, function, motor_step, stack
from backends.engine import Team
from backends.state import Array

USER_NUMBERS = 2
"""Length of a world's user data: its number and the address of `CallbackArgs`, both exact in a
double."""
QPOS, QVEL, APPLIED, USER = (
    int(getattr(mujoco.mjtState, f"mjSTATE_{name}"))
    for name in ("QPOS", "QVEL", "QFRC_APPLIED", "USERDATA")
)
"""Bits of this version's mjtState; a state holds its parts in the order of their bits."""
_HEAD = 10
"""Length of the fixed part of `CallbackArgs`: worlds, drive periods in a policy period, joints,
lengths of qpos and qvel, place of the stick in qvel, and the addresses of the drive arguments, of
the worlds' ages, of the ages up to which sticks are weightless and of the forces that carry them.
The joints' places in qpos and qvel follow."""

_library = find("mujoco", "libmujoco.so*")
_model, _data = types.voidptr, types.voidptr
_copy = types.void, _model, _data, types.uintp, types.intc
_get, _set = (function(_library, name, *_copy) for name in ("mj_getState", "mj_setState"))


@numba.cfunc(types.void(_model, _data), cache=True)
def control(model, data):
    """Advance the motors of one world by one drive period and apply their torques."""
    user = numba.carray(stack(USER_NUMBERS), USER_NUMBERS)
    _get(model, data, user.ctypes.data, USER)
    n, args = int(user[0]), user[1]
    head = array_at(args, _HEAD)
    worlds, ticks, joints = int(head[0]), int(head[1]), int(head[2])
    q_size, v_size, stick = int(head[3]), int(head[4]), int(head[5])
    age, lifted = array_at(head[7], worlds).view(np.int64), array_at(head[8], worlds).view(np.int64)
    places = array_at(args, _HEAD + 2 * joints)[_HEAD:]
    state = numba.carray(stack(q_size + v_size), q_size + v_size)
    applied = numba.carray(stack(v_size), v_size)
    angle, rate = numba.carray(stack(joints), joints), numba.carray(stack(joints), joints)
    _get(model, data, state.ctypes.data, QPOS | QVEL)
    for j in range(joints):
        angle[j] = state[int(places[j])]
        rate[j] = state[q_size + int(places[joints + j])]
    for i in range(v_size):
        applied[i] = 0.0
    torque = motor_step(head[6], n, age[n] % ticks, angle, rate)
    for j in range(joints):
        applied[int(places[joints + j])] = torque[j]
    if age[n] < lifted[n]:
        carry_n = array_at(head[9], (worlds, 3))
        for i in range(3):
            applied[stick + i] = carry_n[n, i]
    age[n] += 1
    _set(model, data, applied.ctypes.data, APPLIED)


CALLBACK = control.ctypes
"""`control`, as MuJoCo takes it."""


class CallbackArgs:
    """The arguments of the callback for N worlds: places of joints and sticks, and the drives."""

    def __init__(
        self,
        team: Team,
        age_steps: Array,
        sizes: tuple[int, int],
        joints_at: tuple[Array, Array],
        stick_at: int,
    ) -> None:
        """`age_steps` (N,) are the worlds' ages in drive periods, which the callback counts."""
        self.drive_args = DriveCallArgs(team.drives, team.applied_nm)
        self._arrays = age_steps, team.lifted_steps, team.carry_n
        addresses = [array.ctypes.data for array in self._arrays]
        args = self.drive_args.address, *addresses
        head = [*team.applied_nm.shape, *sizes, stick_at, *args]
        self._numbers = np.array([*head, *joints_at[0], *joints_at[1]], dtype=np.float64)

    def user_data(self) -> Array:
        """User data (N, 2) of all worlds."""
        return np.array([(n, self._numbers.ctypes.data) for n in range(len(self._arrays[0]))])
