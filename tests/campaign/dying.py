"""Make this process die at a file operation or at a moment, as a kill would have it."""

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

CHANGES = frozenset({"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"})
"""Audit events that change files, besides `open`."""
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC

_watching: list[tuple[Callable[[], None], str, int]] = []
"""What is called before each operation, below which folder, in which process; at most one."""


def counted(call: Callable[[], int]) -> tuple[int, int]:
    """Exit code of a call in this process, and how many operations changed a file here."""
    seen: list[None] = []
    _before_each(lambda: seen.append(None))
    try:
        return call(), len(seen)
    finally:
        _watching.clear()


def die_at(call: Callable[[], int], operation: int) -> int:
    """Make a call and kill this process before an operation that changes a file here."""
    left = [operation]

    def count() -> None:
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1

    _before_each(count)
    return call()


def die_after(call: Callable[[], int], after_s: float) -> int:
    """Make a call and kill this process after a time."""
    own = os.getpid()
    if os.fork() == 0:  # a process that does nothing but wait and kill
        time.sleep(after_s)
        os.kill(own, signal.SIGKILL)
        os._exit(0)
    return call()


def _before_each(act: Callable[[], None]) -> None:
    """From now on, call this before each operation of this process that changes a file here."""
    _watching[:] = [(act, f"{Path.cwd()}/", os.getpid())]


def _hook(event: str, arguments: tuple) -> None:
    if not _watching or not _changes(event, arguments):
        return
    act, here, process = _watching[0]
    path = arguments[0]
    if isinstance(path, bytes):
        path = path.decode(errors="replace")
    inside = isinstance(path, str | Path) and os.path.abspath(path).startswith(here)
    if inside and os.getpid() == process:
        act()


def _changes(event: str, arguments: tuple) -> bool:
    if event == "open":
        return isinstance(arguments[2], int) and bool(arguments[2] & WRITES)
    return event in CHANGES


sys.addaudithook(_hook)
