"""Run `bench diagnose` in its own process, in parallel with other work."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from benchmark.console import Bar
from benchmark.errors import CommandError
from benchmark.settings.variables import without_variables

COMMAND = (sys.executable, "-m", "benchmark")
POLL_S = 0.2


class Diagnosing:
    """A running diagnosis of one log."""

    def __init__(self, child: subprocess.Popen, said: IO[bytes]) -> None:
        self._child, self._said, self._began_s = child, said, time.monotonic()

    def result(self) -> dict:
        """Wait for the diagnosis and return its result; raises CommandError if it failed."""
        with Bar("diagnose the log", 1) as bar:
            while self._child.poll() is None:
                bar.update(0, self._note())
                time.sleep(POLL_S)
            bar.update(1)
        self._said.seek(0)
        found = json.loads(self._said.read().strip() or b"{}")
        if self._child.returncode != 0:
            reason = found.get("error", f"exit code {self._child.returncode}")
            raise CommandError(f"the diagnosis failed: {reason}")
        return found

    def _note(self) -> str:
        passed_s = time.monotonic() - self._began_s
        return f"running for {passed_s:.0f} s; the first one compiles for some 15 s"


@contextlib.contextmanager
def diagnosing(log: Path, out: Path) -> Iterator[Diagnosing]:
    """Diagnose a log on one core during the block; the process ends with the block."""
    words = ("diagnose", str(log), "--out", str(out), "--json")
    with tempfile.TemporaryFile() as said:  # a pipe that nobody reads meanwhile could fill up
        child = subprocess.Popen(
            [*COMMAND, *words],
            stdout=said,
            stderr=subprocess.DEVNULL,
            env=without_variables(),
            start_new_session=True,  # Ctrl-C is for the demo, which ends it
        )
        try:
            yield Diagnosing(child, said)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)
            child.wait()
