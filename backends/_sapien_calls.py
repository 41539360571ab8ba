"""Step SAPIEN from compiled code through its C++ library, without Python in between.

A Python call costs 1.6 us on top of a step of 23 us. The library below exports the same methods. By
the C++ ABI of x86-64 they take the object as their first argument. A vector is passed as an address
and a count. Where a method returns a vector, the caller passes the address for it and frees its
memory afterwards.
"""

import ctypes
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.extending import intrinsic

from backends._calls import find, function, motor_step

_library = str(Path(find("sapien", "__init__.py")).parents[1] / "sapien.libs" / "libsapien.so")
_ARTICULATION = "_ZN6sapien5physx17PhysxArticulation"
POINTER = np.uintp
"""What `pointer` gives, as an array holds it."""
_SIMPLE = 2
"""Flag of a Python object that holds the C++ address directly (`instance` in
pybind11/detail/common.h)."""
_at, _nothing = types.uintp, types.void
_step = function(_library, "_ZN6sapien5physx14PhysxSystemCpu4stepEv", _nothing, _at)
_set_qf = function(
    _library,
    _ARTICULATION + "5setQfERKN5Eigen6MatrixIfLin1ELi1ELi0ELin1ELi1EEE",
    _nothing,
    _at,
    _at,
)
_get_qpos = function(_library, _ARTICULATION + "7getQposEv", _nothing, _at, _at)
_get_qvel = function(_library, _ARTICULATION + "7getQvelEv", _nothing, _at, _at)
_BODY = "_ZN6sapien5physx23PhysxRigidBodyComponent"
_force = function(
    _library,
    _BODY + "14addForceTorqueERKNS_4Vec3ES4_N5physx11PxForceMode4EnumE",
    _nothing,
    _at,
    _at,
    _at,
    types.intc,
)
_free = function(_library, "free", _nothing, _at)


def _pointer(typing_context, address):
    """A pointer, as `numba.carray` takes it, to the 32-bit floats at an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float32)(types.uintp), generate


_floats_at: Any = intrinsic(_pointer)


def pointer(wrapped: object) -> int:
    """Address of the C++ object that pybind11 wrapped.

    Behind the header of the Python object stands this address, or a pointer to it.
    """
    word = ctypes.sizeof(ctypes.c_void_p)
    head = (ctypes.c_size_t * (type(wrapped).__basicsize__ // word)).from_address(id(wrapped))
    first, flags = head[object.__basicsize__ // word], head[-1]
    return first if flags & _SIMPLE else ctypes.c_size_t.from_address(first).value


@numba.njit(cache=True)
def _push(hand, place, torque):
    """Set the joint torques (J,) of a hand; they stay until the next call."""
    values, vector = np.empty(len(torque), dtype=np.float32), np.empty(2, dtype=np.uintp)
    for j in range(len(torque)):
        values[place[j]] = torque[j]
    vector[0], vector[1] = values.ctypes.data, len(torque)
    _set_qf(hand, vector.ctypes.data)


@numba.njit(cache=True)
def _take(vector, place, out):
    """Copy the numbers of a returned vector from the given places, then free the vector."""
    values = numba.carray(_floats_at(vector[0]), len(out))
    for j in range(len(out)):
        out[j] = values[place[j]]
    _free(vector[0])


@numba.njit(cache=True)
def _read(hand, place, angle, speed):
    """Read the joints of one hand."""
    vector = np.empty(2, dtype=np.uintp)
    _get_qpos(vector.ctypes.data, hand)
    _take(vector, place, angle)
    _get_qvel(vector.ctypes.data, hand)
    _take(vector, place, speed)


@numba.njit(cache=True)
def coast(systems, hands, place, torque, ticks, angle, speed):
    """Step every world `ticks` times under constant torques (N, J), then read its joints.

    `systems` and `hands` (N,) are pointers; `place` (J,) holds the index of each joint in SAPIEN's
    vectors.
    """
    for n in range(len(systems)):
        _push(hands[n], place, torque[n])
        for _ in range(ticks):
            _step(systems[n])
        _read(hands[n], place, angle[n], speed[n])


@numba.njit(cache=True)
def drive(systems, hands, place, args, ticks, angle, speed, sticks, carried, force):
    """Step every world `ticks` times under the drives whose `DriveCallArgs` are at `args`.

    Of these, forces (N, 3) act on the sticks during the first `carried` (N,).
    """
    acting, none = force.astype(np.float32), np.zeros(3, dtype=np.float32)
    for n in range(len(systems)):
        for tick in range(ticks):
            if tick < carried[n]:
                _force(sticks[n], acting[n].ctypes.data, none.ctypes.data, 0)
            _push(hands[n], place, motor_step(args, n, angle[n], speed[n]))
            _step(systems[n])
            _read(hands[n], place, angle[n], speed[n])
