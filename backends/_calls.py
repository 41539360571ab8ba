"""What compiled code needs to step an engine: its C functions, and the drives as one address.

Compiled code calls the drive law between an engine's steps. A call from Python would cost as much
as the drive law itself. An address and a world's number are the cheapest arguments, and a C library
can pass them on.
"""

import ctypes
import importlib
import warnings
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
from llvmlite import binding
from numba.core import types
from numba.core.types import ExternalFunction
from numba.extending import intrinsic

from backends.drive import COLUMNS, MEMORY, DriveBank, motor_tick
from backends.state import Array


def chosen(package: str, known: tuple[str, ...], compiled: str, public: str) -> ModuleType:
    """The calls that step an engine: compiled ones, or those of its public Python interface.

    Compiled calls go below the public interface, so they need a wheel whose layout is `known` by
    its version. Of another wheel, the public ones give the same results and take longer; a warning
    says so. Raises ModuleNotFoundError without the package.
    """
    version = metadata.version(package)
    try:
        if version not in known:
            raise ImportError(f"known are {', '.join(known)}")
        return importlib.import_module(compiled)
    except Exception as error:  # noqa: BLE001 - a layout that is not known may fail in any way
        warnings.warn(
            f"{package} {version} is stepped by its public calls, which take longer: its layout is "
            f"not a known one ({error}); install {package}=={known[-1]} for compiled ones",
            RuntimeWarning,
            stacklevel=2,
        )
        return importlib.import_module(public)


def find(package: str, pattern: str) -> str:
    """Path of a library of an installed package; raises ModuleNotFoundError without it."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"No module named '{package}'", name=package)
    return str(next(Path(spec.origin).parent.glob(pattern)))


def address(library: str, name: str) -> int:
    """Address of a function of a library."""
    function = getattr(ctypes.CDLL(library), name)
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def function(library: str, name: str, result: Any, *arguments: Any) -> Any:
    """A library function that numba-compiled code can call, with numba's types."""
    binding.add_symbol(name, address(library, name))
    return ExternalFunction(name, result(*arguments))


_HEAD = 11
"""Length of the argument block: worlds, drive periods in a policy period, joints, drive period,
whether drives have extras, then the addresses of six arrays."""
_NUMBERS = len(COLUMNS) + len(MEMORY)


def _pointer(typing_context, address):
    """A pointer, as `numba.carray` takes it, to the 64-bit floats at an address."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.double)(types.uintp), generate


_doubles_at: Any = intrinsic(_pointer)


def _room(typing_context, size):
    """A pointer to room for some 64-bit floats on the stack of the function that asks."""

    def generate(context, builder, signature, arguments):
        return builder.alloca(context.get_value_type(types.double), arguments[0])

    return types.CPointer(types.double)(types.intp), generate


stack: Any = intrinsic(_room)


@numba.njit(cache=True)
def array_at(address, shape):
    """The array of 64-bit floats at an address, itself a float or an integer."""
    return numba.carray(_doubles_at(np.uintp(address)), shape)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def motor_step(address, n, tick, angle, rate):
    """Advance the motors of world `n` by a drive period, the policy period's number `tick`.

    Returns its joint torques (J,) [Nm]. Until all are known, results wait on the stack, where they
    overlap no argument: only so are several drives computed at a time.
    """
    head = array_at(address, _HEAD)
    shape, ticks, dt, extra = (int(head[0]), int(head[2])), int(head[1]), head[3], head[4] != 0.0
    target, motor = array_at(head[5], shape), array_at(head[6], shape)
    speed, p = array_at(head[7], shape), array_at(head[8], (shape[0], _NUMBERS, shape[1]))
    pd, applied = array_at(head[9], shape), array_at(head[10], (shape[0], ticks, shape[1]))[n, tick]
    joints = shape[1]
    new_motor, new_speed = numba.carray(stack(joints), joints), numba.carray(stack(joints), joints)
    new_pd, torque = numba.carray(stack(joints), joints), numba.carray(stack(joints), joints)
    for j in range(joints):
        asked, rotor = (target[n, j], angle[j], rate[j]), (motor[n, j], speed[n, j], pd[n, j])
        if extra:
            new_motor[j], new_speed[j], new_pd[j], torque[j] = motor_tick(
                *asked, *rotor, p[n, :, j], dt, True
            )
        else:
            new_motor[j], new_speed[j], new_pd[j], torque[j] = motor_tick(
                *asked, *rotor, p[n, :, j], dt, False
            )
    for j in range(joints):
        motor[n, j], speed[n, j], pd[n, j] = new_motor[j], new_speed[j], new_pd[j]
        applied[j] = torque[j]
    return applied


class DriveCallArgs:
    """The arguments with which compiled code advances the motors of a drive bank."""

    def __init__(self, drives: DriveBank, applied_nm: Array) -> None:
        """Torques of a policy period are written into `applied_nm` (N, T, J)."""
        motor, speed, numbers, dt_s, extra, pd, _ = drives.rotors
        self.target_rad: Array = np.zeros_like(motor)
        """Target angles (N, J) [rad]; write them before each policy period."""
        self._arrays = (self.target_rad, motor, speed, numbers, pd, applied_nm)
        addresses = [array.ctypes.data for array in self._arrays]
        self._head = np.array([*applied_nm.shape, dt_s, extra, *addresses], dtype=np.float64)
        self.address = self._head.ctypes.data
        """Address of the argument block, valid as long as this object lives; all its numbers are
        exact in 64-bit floats."""
