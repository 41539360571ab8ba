"""Pass the drives of many worlds to compiled code as one memory address.

Compiled code calls the drive law between an engine's steps. A call from Python would cost as much
as the drive law itself. An address and a world's number are the cheapest arguments, and a C library
can pass them on.
"""

from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic

from backends.drive import DriveBank, motor_tick
from backends.state import Array

_HEAD = 9
"""Length of the argument block: worlds, joints, period, then the addresses of six arrays."""


def _pointer(typing_context, address):
    """A pointer, as `numba.carray` takes it, to the 64-bit floats at an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.double)(types.uintp), generate


_doubles_at: Any = intrinsic(_pointer)


@numba.njit(cache=True)
def array_at(address, shape):
    """The array of 64-bit floats at an address, itself a float or an integer."""
    return numba.carray(_doubles_at(np.uintp(address)), shape)


@numba.njit(cache=True)
def motor_step(address, n, angle, rate):
    """Advance the motors of world `n` by one drive period; returns its joint torques (J,) [Nm]."""
    head = array_at(address, _HEAD)
    joints, dt = int(head[1]), head[2]
    shape = int(head[0]), joints
    target, motor = array_at(head[3], shape), array_at(head[4], shape)
    speed, p = array_at(head[5], shape), array_at(head[6], (13, shape[0], joints))
    pd, gear = array_at(head[7], shape), array_at(head[8], shape)
    for j in range(joints):
        motor[n, j], speed[n, j], pd[n, j], gear[n, j] = motor_tick(
            target[n, j], angle[j], rate[j], motor[n, j], speed[n, j], p[:, n, j], dt
        )
    return gear[n]


class DriveCallArgs:
    """The arguments with which compiled code advances the motors of a drive bank."""

    def __init__(self, drives: DriveBank) -> None:
        motor, speed, parameters, dt_s, pd, gear = drives.rotors
        self.target_rad: Array = np.zeros_like(motor)
        """Target angles (N, J) [rad]; write them before each policy period."""
        self._arrays = (self.target_rad, motor, speed, parameters, pd, gear)
        addresses = [array.ctypes.data for array in self._arrays]
        self._head = np.array([*motor.shape, dt_s, *addresses], dtype=np.float64)
        self.address = self._head.ctypes.data
        """Address of the argument block, valid as long as this object lives; all its numbers are
        exact in 64-bit floats."""
