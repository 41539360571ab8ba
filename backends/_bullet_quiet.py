"""pybullet, imported without what it prints, which cannot be switched off."""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

OUT, ERR = 1, 2
"""Standard streams."""


@contextmanager
def muted(stream: int) -> Iterator[None]:
    """Mute a standard stream, compiled code's as well."""
    flush = ctypes.CDLL(None).fflush
    flush(None)
    kept, void = os.dup(stream), os.open(os.devnull, os.O_WRONLY)
    os.dup2(void, stream)
    try:
        yield
    finally:
        flush(None)
        os.dup2(kept, stream)
        os.close(kept)
        os.close(void)


with muted(ERR):  # its build time
    import pybullet as p

__all__ = ["ERR", "OUT", "muted", "p"]
