"""Commands killed at a file operation or at a moment, taken up, and compared with a whole call.

A kill is SIGKILL before the n-th operation that changes a file, or after a share of the time that
the whole call takes. What it leaves is taken up by the command that its message advises.
"""

import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.cli import app
from tests.campaign import bases
from tests.campaign.contents import differing
from tests.campaign.table import Case
from tests.campaign.watch import Outcome, watched

OUT = "out"
COUNTED = "operations"
"""File in which a whole call leaves the number of its operations."""
CHANGES = frozenset({"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"})
"""Audit events that change files, besides `open`."""
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
BY_TIME = 0.25
"""Share of the kills that come at a moment."""
PATIENCE_S = 900.0
"""Time for the whole call, which compiles [s]."""


@dataclass(frozen=True, kw_only=True)
class Killed:
    """A command that is killed."""

    words: list[str]
    again: list[str]
    """Words that are added when it is taken up."""
    base: Callable[[Path], None] | None = None
    """Writes what it works on."""
    finished: bool = False
    """Whether it begins where a whole call has ended, with --force."""


RUN = ["run", "--task", "line", "--smoke"]
SHORT = ["--set", "rollout_steps=32", "--steps", "512"]
RECORD = ["record", "--protocol", "steps", "--rate", "50Hz", "--effects", "backlash=1deg@J3"]
ONE = ["-j", "1", "-q"]


def _runs() -> dict[str, Killed]:
    return {
        f"run {backend} {algo}": Killed(
            words=[*RUN, *more, "--backend", backend, "--algo", algo, "--out", OUT, *ONE],
            again=["--resume"],
        )
        for backend in ("mujoco", "bullet", "sapien")
        for algo, more in (("sb3-ppo", SHORT), ("rsl-ppo", SHORT), ("hold-still", []))
    }


def _logs() -> dict[str, Killed]:
    return {
        f"record {backend}": Killed(
            words=[*RECORD, "--backend", backend, "--out", OUT, *ONE], again=["--force"]
        )
        for backend in ("mujoco", "bullet", "sapien")
    }


def _transfers() -> dict[str, Killed]:
    deployed = ["--effects", "none", "--episodes", "2", "--include-smoke"]
    return {
        f"transfer {backend}": Killed(
            words=["transfer", "run", "--backend", backend, *deployed, "--out", OUT, *ONE],
            again=[],
            base=bases.run,
        )
        for backend in ("mujoco", "bullet", "sapien")
    }


KINDS: Mapping[str, Killed] = {
    **_runs(),
    "run --force": Killed(
        words=[*RUN, *SHORT, "--backend", "mujoco", "--out", OUT, *ONE],
        again=["--resume"],
        finished=True,
    ),
    **_logs(),
    **_transfers(),
    "eval": Killed(
        words=["eval", "run", "--episodes", "2", "--out", OUT, *ONE], again=[], base=bases.run
    ),
    "leaderboard": Killed(
        words=["leaderboard", "run", "--add", "--policies", "--out", OUT], again=[], base=bases.run
    ),
    "excite": Killed(words=["excite", "--out", f"{OUT}/commands.csv"], again=["--force"]),
    "import": Killed(
        words=["import", "bam", "bam.json", "--out", OUT], again=["--force"], base=bases.bam
    ),
    "view": Killed(
        words=["view", "run", "--kind", "curve", "--out", f"{OUT}/a.png"], again=[], base=bases.run
    ),
    "sweep": Killed(
        words=["sweep", "sweep.yaml", "--out", OUT, *ONE], again=[], base=bases.small_sweep
    ),
    "diagnose": Killed(
        words=["diagnose", "log", "--out", OUT, *ONE], again=["--force"], base=bases.short_log
    ),
    "blind make": Killed(
        words=["blind", "make", "--rig", "joint", "--cases", "2", "--real", "mujoco", "--seed", "3",
               "--out", OUT, "--answers", "answers.json", *ONE],
        again=[],
    ),
}  # fmt: skip
"""Commands by name; a sweep's cells are processes of their own."""
QUICK = ("run mujoco hold-still", "record mujoco", "leaderboard", "excite", "import")
"""Those that take little time."""


def case(name: str, seed: int, number: int, shelf: Path, hang_s: float) -> Case:
    """Kill a command once, take it up, and compare; whole calls are kept on the shelf."""
    killed, whole = KINDS[name], shelf / name.replace(" ", "_")
    if not whole.exists():
        _whole(killed, whole)
    rng = np.random.default_rng([seed, number])
    with tempfile.TemporaryDirectory(prefix="kill-") as place:
        folder = Path(place)
        _prepare(killed, folder, whole)
        at, outcome = _kill(killed, folder, whole, rng, hang_s)
        taken = watched(_call(killed, killed.again), folder, 2 * hang_s)
        fault = outcome.fault if outcome.code >= 0 else ""
        fault = fault or taken.fault or ("stuck" if taken.code != 0 else "")
        differs = differing(folder / OUT, whole / OUT)
        fault = fault or ("changed" if differs else "")
    said = (taken.said.strip().splitlines() or [""])[-1]
    return Case(
        part="kills",
        kind=name,
        seed=seed,
        number=number,
        refused=False,
        fault=fault,
        said=f"{at}; {said}; changed: {', '.join(differs)}" if fault else at,
    )


def _whole(killed: Killed, whole: Path) -> None:
    """Make a call that is not killed, and count its operations; raises RuntimeError."""
    _prepare(killed, whole, None)
    call = _call(killed, [])
    if killed.finished:
        watched(call, whole, PATIENCE_S)
        call = _call(killed, ["--force"])
    outcome = watched(lambda: _counted(call), whole, PATIENCE_S)
    if outcome.code != 0:
        shutil.rmtree(whole)
        raise RuntimeError(f"{' '.join(killed.words)} failed unkilled: {outcome.said}")
    again = watched(call, whole, PATIENCE_S) if killed.finished else None
    (whole / "wall_s").write_text(str((again or outcome).wall_s))


def _prepare(killed: Killed, folder: Path, whole: Path | None) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    if killed.base is not None:
        killed.base(folder)
    if killed.finished and whole is not None:
        shutil.copytree(whole / OUT, folder / OUT)


def _call(killed: Killed, more: list[str]) -> Callable[[], int]:
    return lambda: app.call([*killed.words, *more])


def _counted(call: Callable[[], int]) -> int:
    """Make a call and leave the number of its operations in a file."""
    seen = [0]
    _before_each(lambda: seen.__setitem__(0, seen[0] + 1))
    code = call()
    Path(COUNTED).write_text(str(seen[0]))
    return code


def _kill(
    killed: Killed, folder: Path, whole: Path, rng: np.random.Generator, hang_s: float
) -> tuple[str, Outcome]:
    """Where the kill came, and how the call ended."""
    call = _call(killed, ["--force"] if killed.finished else [])
    operations = int((whole / COUNTED).read_text())
    if rng.random() < BY_TIME or operations == 0:
        after_s = float(rng.random()) * min(float((whole / "wall_s").read_text()), hang_s)
        return f"after {after_s:.2f} s", watched(lambda: _die_after(call, after_s), folder, hang_s)
    at = int(rng.integers(operations))
    return f"at operation {at} of {operations}", watched(lambda: _die_at(call, at), folder, hang_s)


def _die_at(call: Callable[[], int], operation: int) -> int:
    left = [operation]

    def count() -> None:
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1

    _before_each(count)
    return call()


def _die_after(call: Callable[[], int], after_s: float) -> int:
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    own = os.getpid()
    if os.fork() == 0:  # a process that does nothing but wait and kill
        import time

        time.sleep(after_s)
        os.kill(own, signal.SIGKILL)
        os._exit(0)
    return call()


def _before_each(act: Callable[[], None]) -> None:
    """From now on, call this before each operation of this process that changes a file here."""
    here, own = f"{Path.cwd()}/", os.getpid()

    def hook(event: str, arguments: tuple) -> None:
        if event == "open":
            path, _, flags = arguments
            if not (isinstance(flags, int) and flags & WRITES):
                return
        elif event not in CHANGES:
            return
        else:
            path = arguments[0]
        if isinstance(path, bytes):
            path = path.decode(errors="replace")
        inside = isinstance(path, str | Path) and os.path.abspath(path).startswith(here)
        if inside and os.getpid() == own:
            act()

    sys.addaudithook(hook)
