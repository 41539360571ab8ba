"""Run a call in a process of its own, watched: how it ended, what it said, and how large it was.

The process is a fork of this one, so that engines and learners are loaded once. A hang is a call
that computes for too long, whatever else the machine does meanwhile, or waits for ever.
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

HANG_CPU_S = 60
"""More CPU time is a hang [s]: of one process, or of all that it started together."""
WAIT_S = 1800.0
"""Longer is a hang, too [s]: for a call that waits and computes nothing."""
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
    peak_bytes: int
    """Most memory that the process itself had."""
    hung: bool
    """Whether it computed or waited for too long."""

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


def watched(
    call: Callable[[], int], folder: Path, cpu_s: int = HANG_CPU_S, wait_s: float = WAIT_S
) -> Outcome:
    """Run `call` in a fork within `folder`; everything it started is ended with it."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            _run(call, folder, said.fileno(), cpu_s)
        status, waited, usage = _wait(child, time.monotonic() + wait_s)
        with suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return Outcome(
        code=os.waitstatus_to_exitcode(status),
        said=text,
        peak_bytes=usage.ru_maxrss * 1024,
        hung=waited or usage.ru_utime + usage.ru_stime > cpu_s,
    )


def here(call: Callable[[], int], folder: Path) -> Outcome:
    """Run `call` in this process within `folder`: what it loads stays loaded."""
    before = Path.cwd()
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
    return Outcome(code=code, said=text, peak_bytes=0, hung=False)


def _run(call: Callable[[], int], folder: Path, said: int, cpu_s: int) -> None:
    """The child: never returns."""
    code = CRASH
    try:
        os.setsid()
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        os.dup2(os.open(os.devnull, os.O_RDWR), 1)
        os.dup2(said, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # Ends each process beyond it; those it started inherit it.
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s + 1, cpu_s + 10))
        code = call()
    except BaseException:  # noqa: BLE001 - the parent is told of all of them
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


def _wait(child: int, deadline_s: float) -> tuple[int, bool, resource.struct_rusage]:
    """Status of the child, whether it was ended for its time, and what it used with its own."""
    waited = False
    while True:
        ended, status, usage = os.wait4(child, os.WNOHANG)
        if ended:
            return status, waited, usage
        if time.monotonic() > deadline_s or _size_bytes(child) > MOST_BYTES:
            waited = time.monotonic() > deadline_s
            with suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
        time.sleep(POLL_S)


def _size_bytes(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0
