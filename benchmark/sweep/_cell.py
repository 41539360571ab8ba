"""One cell of a sweep: `bench run` in its own process, monitored, with a time limit.

The same function runs a cell on this machine and on a node of a cluster. A crash, a hang or a kill
of the process ends in an `Outcome`, so no cell affects another one.
"""

import contextlib
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from benchmark.errors import CommandError
from benchmark.runs import run_folder
from benchmark.settings.run_spec import RunSpec
from benchmark.settings.variables import without_variables

LOGS = "logs"
"""Folder for the output of the cells, in the sweep's folder."""
GRACE_S = 10.0
"""Time in which a stopped cell may end by itself before it is killed [s]."""
POLL_S = 0.2
GOOD = ("done", "was done")
STOPPED = "stopped with the sweep; the same command goes on with it"
_INTERRUPTED = 130
_BENCH = (
    "import ctypes, signal; ctypes.CDLL(None).prctl(1, signal.SIGTERM); "
    "from benchmark.cli.app import main; main()"
)
"""Runs `bench`; Linux stops it (PR_SET_PDEATHSIG is 1) if the sweep that started it dies."""
_SHARE = re.compile(rb"(\w+) [^\n]* (\d+)/(\d+) [^\n]*\n?\Z")


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One run of a sweep."""

    options: dict[str, Any]
    """Options of `bench run`, by name."""
    spec: RunSpec
    """The run of these options."""
    out: Path
    """The sweep's folder."""

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.out / self.spec.name

    @property
    def log(self) -> Path:
        """File with the output of the cell."""
        return self.out / LOGS / f"{self.spec.name}.log"

    def command(self, cores: int) -> list[str]:
        """The arguments of `bench` that run or continue this cell."""
        words = ["run"]
        for name, value in self.options.items():
            flag = f"--{name.replace('_', '-')}"
            if isinstance(value, bool):
                words += [flag] if value else [f"--no{flag[1:]}"] if name != "smoke" else []
            elif isinstance(value, dict):
                words += [word for pair in value.items() for word in (flag, "{}={}".format(*pair))]
            else:
                words += [flag, str(value)]
        return [*words, "--out", str(self.path), "--workers", str(cores), "--resume", "--json"]

    def progress(self) -> str:
        """Progress of the cell by its log, such as 'train 45 %'."""
        with contextlib.suppress(OSError), self.log.open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - 400))
            if match := _SHARE.search(log.read()):
                return f"{match[1].decode()} {100 * int(match[2]) // max(int(match[3]), 1)} %"
        return "starting"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a cell ended."""

    name: str
    """The run's name."""
    state: str
    """done, was done, failed, crashed, timed out, interrupted, or busy (run by another sweep)."""
    reason: str = ""
    wall_s: float = 0.0
    """Time of the cell's process [s]."""
    row: dict | None = None
    """The row that `bench run` prints for a finished run."""

    @property
    def good(self) -> bool:
        """Whether the cell's run is finished."""
        return self.state in GOOD


def finished(cell: Cell) -> Outcome | None:
    """The outcome of a cell whose run is done and intact, else None."""
    from benchmark.runs.run import row

    try:
        run = run_folder.read_run(cell.path)
        run_folder.check_policy(cell.path, run)
    except CommandError:
        return None
    if run["status"] != "done" or run["digest"] != cell.spec.digest:
        return None
    return Outcome(name=cell.spec.name, state="was done", row=row(run, cell.path))


def run_cell(
    cell: Cell,
    limit_s: float,
    cores: int = 1,
    beat: Callable[[Cell], bool] = lambda cell: False,
) -> Outcome:
    """Run or continue a cell in its own process; returns the outcome.

    `beat` is called every POLL_S. The cell is stopped if it returns True, or after `limit_s`.
    """
    name = cell.spec.name
    if beat(cell):
        return Outcome(name=name, state="interrupted", reason="not started")
    try:
        cell.log.parent.mkdir(parents=True, exist_ok=True)
        with cell.log.open("ab") as log:
            if _locked(log, lambda: beat(cell)):
                return _run_locked(cell, limit_s, cores, beat, log)
    except OSError as error:
        return Outcome(name=name, state="failed", reason=str(error))
    return Outcome(name=name, state="busy", reason=f"another process runs it; see {cell.log}")


def _run_locked(
    cell: Cell, limit_s: float, cores: int, beat: Callable[[Cell], bool], log: IO[bytes]
) -> Outcome:
    log.truncate(0)
    began = time.monotonic()
    with _process(cell, cores, log) as process:
        stopped = _watch(process, lambda: beat(cell), began + limit_s)
        said = process.stdout.read() if process.stdout else b""
    outcome = _outcome(cell, process.returncode, stopped, said, time.monotonic() - began)
    if outcome.state in ("timed out", "crashed"):
        _mark(cell, outcome.reason)
    return outcome


def _locked(log: IO[bytes], stop: Callable[[], bool]) -> bool:
    """Lock a cell's log, once the cell of a sweep that was killed has ended; False if it does not.

    Such a cell may take GRACE_S.
    """
    deadline_s = time.monotonic() + GRACE_S
    while not (locked := _lock(log)) and time.monotonic() < deadline_s and not stop():
        time.sleep(POLL_S)
    return locked


def _lock(log: IO[bytes]) -> bool:
    """Lock a cell's log while this process or the cell has it open; False if it is locked."""
    try:
        fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks: nothing can be known
        pass
    return True


@contextlib.contextmanager
def _process(cell: Cell, cores: int, log: IO[bytes]) -> Iterator[subprocess.Popen]:
    """The cell's process in its own process group, which is ended with it."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _BENCH, *cell.command(cores)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=log,
        env={**without_variables(), "OMP_NUM_THREADS": "1"},
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            _signal(process, signal.SIGKILL)
            process.wait()


def _watch(process: subprocess.Popen, stop: Callable[[], bool], deadline_s: float) -> str:
    """Wait for a process; returns the reason if it was stopped."""
    stopped = ""
    while not stopped:
        try:
            process.wait(POLL_S)
            break
        except subprocess.TimeoutExpired:
            stopped = "interrupted" if stop() else ""
            stopped = "timed out" if time.monotonic() > deadline_s else stopped
    if stopped:
        _signal(process, signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GRACE_S)
    _signal(process, signal.SIGKILL)
    return stopped


def _signal(process: subprocess.Popen, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)


def _outcome(cell: Cell, code: int, stopped: str, said: bytes, wall_s: float) -> Outcome:
    try:
        row = json.loads(said)
    except ValueError:
        row = {}
    state, reason = _ending(code, stopped, row, wall_s)
    if state != "done" and not stopped:
        reason = f"{reason}; see {cell.log}"
    done = row if state == "done" else None
    return Outcome(name=cell.spec.name, state=state, reason=reason, wall_s=wall_s, row=done)


def _ending(code: int, stopped: str, row: dict, wall_s: float) -> tuple[str, str]:
    """State and reason from the exit code and the output of the process."""
    if code == 0 and row.get("status") == "done":
        return "done", ""
    if stopped == "timed out":
        return stopped, f"stopped by the sweep's time limit after {wall_s:.0f} s"
    if stopped or code == _INTERRUPTED:
        return "interrupted", STOPPED if stopped else "the cell was interrupted"
    if code < 0:
        hint = ", often because memory ran out" if code == -signal.SIGKILL else ""
        return "crashed", f"killed by {signal.Signals(-code).name}{hint}"
    if "error" not in row:
        return "crashed", f"ended with exit code {code} and no result"
    return "failed", str(row["error"])


def _mark(cell: Cell, reason: str) -> None:
    """Write the reason into the run.json of a cell that could not write it itself."""
    with contextlib.suppress(CommandError):
        run = run_folder.read_run(cell.path)
        if run["status"] == "interrupted" and run["digest"] == cell.spec.digest:
            text = json.dumps({**run, "reason": reason}, indent=2) + "\n"
            run_folder.write_atomically(cell.path / run_folder.RUN_FILE, text)
