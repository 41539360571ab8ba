"""Find functions of an engine's C library, so that compiled code can call them without Python."""

import ctypes
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from llvmlite import binding
from numba.core.types import ExternalFunction


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
