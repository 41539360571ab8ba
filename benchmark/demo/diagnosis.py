"""Run `bench diagnose` in its own process, in parallel with other work."""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmark.console import Bar
from benchmark.errors import CommandError

COMMAND = (sys.executable, "-m", "benchmark")
POLL_S = 0.2
WARM_S = 8.0
"""A diagnosis that takes longer compiles its replay, which is kept [s]."""


class Diagnosing:
    """A running diagnosis of one log."""

    def __init__(self, child: subprocess.Popen) -> None:
        self._child, self._began_s = child, time.monotonic()

    def result(self) -> dict:
        """Wait for the diagnosis and return its result; raises CommandError if it failed."""
        assert self._child.stdout is not None
        with Bar("diagnose the log", 1) as bar:
            while self._child.poll() is None:
                bar.update(0, self._note())
                time.sleep(POLL_S)
            bar.update(1)
        said = self._child.stdout.read().strip() or b"{}"
        found = json.loads(said)
        if self._child.returncode != 0:
            reason = found.get("error", f"exit code {self._child.returncode}")
            raise CommandError(f"the diagnosis failed: {reason}")
        return found

    def _note(self) -> str:
        passed_s = time.monotonic() - self._began_s
        why = ", compiling once after an installation" if passed_s > WARM_S else ""
        return f"{passed_s:.0f} s{why}"


@contextlib.contextmanager
def diagnosing(log: Path, out: Path) -> Iterator[Diagnosing]:
    """Diagnose a log on one core during the block; the process ends with the block."""
    words = ("diagnose", str(log), "--out", str(out), "--workers", "1", "--json")
    child = subprocess.Popen(
        [*COMMAND, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the demo, which ends it
    )
    try:
        yield Diagnosing(child)
    finally:
        child.kill()
        child.communicate()
