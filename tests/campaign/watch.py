"""Run a call in a process of its own, watched: how it ended, what it said, how long and how large.

The process is a fork of this one, so that engines and learners are loaded once.
"""

import os
import resource
import signal
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

HANG_S = 60.0
"""Longer is a hang [s], on a machine that is not shared."""
MOST_BYTES = 4_000_000_000
"""More is too large for a process."""
LONGEST_LINE = 1200
"""Characters in a line of a message; a longer one repeats what it was given."""
POLL_S = 0.02
CRASH = 70
"""Exit code of a child whose call raised."""
KILLED = -signal.SIGKILL
"""Exit code of a child that was killed."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a call ended."""

    code: int
    """Exit code; that of a signal is negative."""
    said: str
    """What it wrote on standard error, and its trace if it raised."""
    wall_s: float
    peak_bytes: int
    """Most memory that the process itself had."""
    hung: bool
    """Whether it was ended for its time."""

    @property
    def fault(self) -> str:
        """What must not happen: traceback, crash, hang, memory, silent, long; else empty."""
        found = {
            "hang": self.hung,
            "memory": self.peak_bytes > MOST_BYTES,
            "traceback": "Traceback" in self.said or "this should not happen" in self.said,
            "crash": self.code not in (0, 1, 2, 130),
            "silent": self.code != 0 and not self.said.strip(),
            "long": any(len(line) > LONGEST_LINE for line in self.said.splitlines()),
        }
        return next((name for name, there in found.items() if there), "")


def watched(call: Callable[[], int], folder: Path, limit_s: float) -> Outcome:
    """Run `call` in a fork within `folder`; everything it started is ended with it."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            _run(call, folder, said.fileno())
        status, hung, peak_bytes = _wait(child, began + limit_s)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return Outcome(
        code=os.waitstatus_to_exitcode(status),
        said=text,
        wall_s=time.monotonic() - began,
        peak_bytes=peak_bytes,
        hung=hung,
    )


def here(call: Callable[[], int], folder: Path) -> Outcome:
    """Run `call` in this process within `folder`: what it loads stays loaded."""
    began, before = time.monotonic(), Path.cwd()
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as said:
        try:
            os.chdir(folder)
            for stream in (1, 2):
                os.dup2(said.fileno(), stream)
            code = call()
        finally:
            os.chdir(before)
            for stream, old in zip((1, 2), kept, strict=True):
                os.dup2(old, stream)
                os.close(old)
        said.seek(0)
        text = said.read().decode(errors="replace")
    wall_s = time.monotonic() - began
    return Outcome(code=code, said=text, wall_s=wall_s, peak_bytes=0, hung=False)


def _run(call: Callable[[], int], folder: Path, said: int) -> None:
    """The child: never returns."""
    code = CRASH
    try:
        os.setsid()
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        os.dup2(os.open(os.devnull, os.O_RDWR), 1)
        os.dup2(said, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        code = call()
    except BaseException:  # noqa: BLE001 - the parent is told of all of them
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


def _wait(child: int, deadline_s: float) -> tuple[int, bool, int]:
    """Status of the child, whether it was ended for its time, and its largest size."""
    hung = False
    while True:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        if ended:
            return status, hung, usage.ru_maxrss * 1024
        if time.monotonic() > deadline_s or _size_bytes(child) > MOST_BYTES:
            hung = time.monotonic() > deadline_s
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
        time.sleep(POLL_S)


def _size_bytes(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0
