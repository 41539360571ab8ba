"""Step SAPIEN from compiled code through its C++ library, without Python in between.

A Python call costs 1.6 us on top of a step of 23 us. The library below exports the same methods. By
the C++ ABI of x86-64 they take the object as their first argument. A vector is passed as an address
and a count. Where a method returns a vector, the caller passes the address for it and frees its
memory afterwards. Three floats come back in two registers.
"""

import ctypes
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from backends._calls import address, array_at, find, function, motor_step

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
_get_pose = function(_library, "_ZNK6sapien9Component7getPoseEv", _nothing, _at, _at)
_free = function(_library, "free", _nothing, _at)
_next_node = function(_library, "_ZSt18_Rb_tree_incrementPKSt18_Rb_tree_node_base", _at, _at)
_LEFTMOST, _COUNT = 15, 17
"""Words of a `PhysxSystemCpu` that hold the first node of its map of contacts, and their count."""
_NODE_CONTACT = 6
"""Word of a node of the map (`_Rb_tree_node` in libstdc++) that holds a contact's address."""
_SHAPES, _POINTS, _END = 2, 4, 5
"""Words of a `Contact` (sapien/physx/simulation_callback.hpp): its two shapes, then the addresses
of its points and of their end."""
_POINT_FLOATS, _POINT_BYTES, _IMPULSE = 10, 40, 6
"""Size of a `ContactPoint`, which begins with its position, and the place of its impulse [N s]."""
_MOST_CONTACTS = 32
"""Largest number of contact points of a world; four per fingertip are rare."""


def _pointer(typing_context, address):
    """A pointer, as `numba.carray` takes it, to the 32-bit floats at an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float32)(types.uintp), generate


_floats_at: Any = intrinsic(_pointer)


def _vector_of(method: str) -> Any:
    """A method of a body that returns a `Vec3`, for compiled code."""
    binding.add_symbol(method, address(_library, method))

    def typed(typing_context, body):
        def generate(context, builder, signature, arguments):
            one, two = ir.FloatType(), ir.VectorType(ir.FloatType(), 2)
            kind = ir.FunctionType(ir.LiteralStructType([two, one]), [ir.IntType(64)])
            called = cgutils.get_or_insert_function(builder.module, kind, method)
            given = builder.call(called, arguments)
            pair = builder.extract_value(given, 0)
            first = [builder.extract_element(pair, ir.IntType(32)(i)) for i in range(2)]
            numbers = [*first, builder.extract_value(given, 1)]
            return context.make_tuple(builder, signature.return_type, numbers)

        return types.UniTuple(types.float32, 3)(types.uintp), generate

    return intrinsic(typed)


_linear = _vector_of("_ZNK" + _BODY[3:] + "17getLinearVelocityEv")
_angular = _vector_of("_ZNK" + _BODY[3:] + "18getAngularVelocityEv")


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
def rollout(systems, hands, place, torque, angle, speed, sticks, carried, force):
    """Step every world T times under torques (N, T, J), and read its joints each time.

    `systems`, `hands` and `sticks` (N,) are pointers; `place` (J,) holds the index of each joint in
    SAPIEN's vectors. Forces (N, 3) act on the sticks in the first `carried` (N,) steps.
    """
    acting, none = force.astype(np.float32), np.zeros(3, dtype=np.float32)
    for n in range(len(systems)):
        for tick in range(torque.shape[1]):
            if tick < carried[n]:
                _force(sticks[n], acting[n].ctypes.data, none.ctypes.data, 0)
            _push(hands[n], place, torque[n, tick])
            _step(systems[n])
            _read(hands[n], place, angle[n], speed[n])


@numba.njit(cache=True)
def drive(systems, hands, place, args, ticks, angle, speed, sticks, carried, force):
    """`rollout` of `ticks` steps under the drives whose `DriveCallArgs` are at `args`."""
    acting, none = force.astype(np.float32), np.zeros(3, dtype=np.float32)
    for n in range(len(systems)):
        for tick in range(ticks):
            if tick < carried[n]:
                _force(sticks[n], acting[n].ctypes.data, none.ctypes.data, 0)
            _push(hands[n], place, motor_step(args, n, tick, angle[n], speed[n]))
            _step(systems[n])
            _read(hands[n], place, angle[n], speed[n])


@numba.njit(cache=True)
def read_sticks(sticks, pos, quat_wxyz, vel, omega):
    """Read the pose and twist of the stick in every world."""
    pose = np.empty(7, dtype=np.float32)
    for n in range(len(sticks)):
        _get_pose(pose.ctypes.data, sticks[n])
        for i in range(4):
            quat_wxyz[n, i] = pose[i]
        for i in range(3):
            pos[n, i] = pose[4 + i]
        vel[n, 0], vel[n, 1], vel[n, 2] = _linear(sticks[n])
        omega[n, 0], omega[n, 1], omega[n, 2] = _angular(sticks[n])


@numba.njit(cache=True)
def _words(address, count):
    """The addresses or integers that stand at an address."""
    return array_at(address, count).view(np.int64)


@numba.njit(cache=True)
def read_contacts(systems, tips, dt):
    """Every contact between hand and stick: one row each, in the layout of `_pool_contacts`.

    `tips` (N, F) are pointers of the fingertips' shapes; impulses act on the first shape.
    """
    table, count = np.empty((len(systems) * _MOST_CONTACTS, 9)), 0
    for n in range(len(systems)):
        system = _words(systems[n], _COUNT + 1)
        node, most = system[_LEFTMOST], count + _MOST_CONTACTS
        for _ in range(system[_COUNT]):
            contact = _words(_words(node, _NODE_CONTACT + 1)[_NODE_CONTACT], _END + 1)
            points = (contact[_END] - contact[_POINTS]) // _POINT_BYTES
            at = numba.carray(_floats_at(np.uintp(contact[_POINTS])), (points, _POINT_FLOATS))
            for k in range(min(points, most - count)):
                row = table[count]
                row[0] = n
                row[1], side = _tip(tips[n], contact[_SHAPES], contact[_SHAPES + 1])
                _fill(at[k], side, dt, row)
                count += 1
            node = _next_node(node)
    return table[:count]


@numba.njit(cache=True)
def _tip(tips, first, second):
    """The fingertip of a contact, and 1 if it is its first shape, else -1."""
    for f in range(len(tips)):
        if tips[f] == first:
            return f, np.float32(1)
        if tips[f] == second:
            return f, np.float32(-1)
    return -1, np.float32(0)


@numba.njit(cache=True)
def _fill(point, side, dt, row):
    """Load, its moment and the force of a contact point, in 32-bit floats as the engine's."""
    x, y, z = point[_IMPULSE] / dt, point[_IMPULSE + 1] / dt, point[_IMPULSE + 2] / dt
    load = np.sqrt(x * x + y * y + z * z)
    row[2] = load
    row[3], row[4], row[5] = load * point[0], load * point[1], load * point[2]
    row[6], row[7], row[8] = side * x, side * y, side * z
