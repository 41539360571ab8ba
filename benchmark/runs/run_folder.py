"""The folder of a run: its files, how a run claims it, and how it survives a kill.

Every file is written under a temporary name and then renamed. `run.json` has status 'interrupted'
until the run has ended, so a killed run needs no clean-up.
"""

import csv
import dataclasses
import fcntl
import json
import os
import re
import weakref
from collections.abc import Callable
from pathlib import Path

from baselines.baseline import Progress
from baselines.saved import CONTRACT_FILE, POLICY_FILE, file_sha256
from benchmark.errors import CommandError, UsageError
from benchmark.provenance import provenance
from benchmark.settings.run_spec import RunSpec
from files.atomic import write_atomically
from files.bounded import FileError, one_line, read_json
from leaderboard.identity import LATER, run_digest

RUNS = Path("runs")
"""Where runs are written if nothing else is said."""
RUN_FILE, PROGRESS_FILE, EPISODES_FILE = "run.json", "progress.csv", "episodes.parquet"
START_FILE = "start.onnx"
"""The policy that training starts from."""
SCHEMA = 1
_CHECKPOINT = re.compile(r"checkpoint-(\d+)\.pt")
_OWN = re.compile(
    r"\..*\.tmp|checkpoint-\d+\.pt|start\.onnx|policy\.onnx|contract\.json|run\.json"
    r"|progress\.csv|episodes\.parquet"
)
"""Files that a run writes."""
_COLUMNS = ("steps", "reward", "p_err_cm", "q_err_deg", "dropped", "wall_s")
STATUSES = ("done", "diverged", "skipped", "interrupted")


def read_run(folder: Path) -> dict:
    """The run.json of a folder, checked; raises CommandError with its fault."""
    path = folder / RUN_FILE
    if not folder.is_dir():
        raise UsageError(f"no run folder at {folder}; give the folder of a run")
    if not path.exists():
        raise UsageError(f"{folder} is not a run folder: it has no {RUN_FILE}")
    try:
        run = read_json(path)
        run_spec(run)
    except FileError as error:
        raise CommandError(f"{path} is damaged: {error}") from error
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        said = one_line(f"{type(error).__name__}: {error}")
        raise CommandError(f"{path} is damaged: {said}") from error
    if run_digest(run["spec"], run.get("spec_digest", "")) != run.get("digest"):
        raise CommandError(
            f"{path} was changed after it was written: its digest does not fit its settings; "
            "restore it, or run again into another folder"
        )
    if run.get("status") not in STATUSES:
        raise CommandError(
            f"{path} has status {run.get('status')!r}; allowed: {', '.join(STATUSES)}"
        )
    return run


def finished_run(folder: Path) -> dict:
    """The run.json of a finished run with an intact policy; raises CommandError otherwise."""
    run = read_run(folder)
    check_policy(folder, run)
    if run["status"] != "done":
        raise UsageError(f"{folder} is {run['status']}: {run['reason']}; finish it first")
    return run


def run_spec(run: dict) -> RunSpec:
    """The RunSpec that a run.json holds."""
    return RunSpec(**run["spec"])


def check_policy(folder: Path, run: dict) -> None:
    """Raise CommandError unless the folder's policy is the one that its run.json names."""
    path = folder / POLICY_FILE
    if run.get("policy_sha256") is None:
        if path.exists() and run.get("status") == "done":
            raise CommandError(
                f"{path} is not spoken of in {RUN_FILE}, which has no policy_sha256; restore it"
            )
        return
    if not path.exists():
        raise CommandError(f"{path} is missing; run the training again with --force")
    if file_sha256(path) != run["policy_sha256"]:
        raise CommandError(
            f"{path} is not the policy of this {RUN_FILE} (its SHA-256 differs); "
            "restore it, or train again with --force"
        )


class RunFolder:
    """The folder of one run."""

    def __init__(self, path: Path, run: RunSpec) -> None:
        self.path, self._run = path, run
        self._unlock: Callable[[], object] = lambda: None

    def claim(self, resume: bool, force: bool) -> dict | None:
        """Prepare the folder; returns the finished run.json if there is nothing left to do.

        Recovers from whatever a kill may have left. Raises UsageError if the folder holds something
        else or an unfinished run, or if another process uses it.
        """
        foreign = [name for name in self._names() if not _OWN.fullmatch(name)]
        if foreign and RUN_FILE not in self._names():
            raise UsageError(
                f"{self.path} is not a run folder: it has no {RUN_FILE}, but {foreign[0]}; "
                "choose another --out"
            )
        self._lock_folder()
        for half_written in self.path.glob(".*.tmp"):
            half_written.unlink()
        if force or RUN_FILE not in self._names():
            self._refuse_remains(resume or force)
            self.drop_checkpoints()
            (self.path / START_FILE).unlink(missing_ok=True)
        else:
            found = read_run(self.path)
            if found["digest"] != self._run.digest:
                raise UsageError(
                    f"{self.path} holds another run ({self._differences(found['spec'])}); choose "
                    "another --out, or --force to replace it"
                )
            if found["status"] == "done":
                check_policy(self.path, found)
                self.drop_checkpoints()
                return found
            if not resume:
                raise UsageError(
                    f"{self.path} holds this run, {found['status']}; --resume continues it, "
                    "--force starts it again"
                )
        self.write_run("interrupted", "the run has not finished")
        if self.checkpoint() == (0, None):
            self._clear()
        return None

    def _differences(self, spec: dict) -> str:
        """The settings in which a run that was found differs from this one."""
        own = dataclasses.asdict(self._run)
        other = [n for n in own if own[n] != spec.get(n, LATER.get(n))]
        said = [f"{name} {spec.get(name)}, not {own[name]}" for name in other]
        return "; ".join(said) or "of another version of the hand"

    def _names(self) -> list[str]:
        return [file.name for file in self.path.iterdir()] if self.path.is_dir() else []

    def _lock_folder(self) -> None:
        """Lock the folder while this process lives; raises UsageError if it is locked."""
        self.path.mkdir(parents=True, exist_ok=True)
        lock = os.open(self.path, os.O_RDONLY)
        self._unlock = weakref.finalize(self, os.close, lock)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f"another process runs in {self.path}; wait for it, or choose another --out"
            ) from None
        except OSError:  # a file system without locks: nothing can be known
            pass

    def close(self) -> None:
        """Let others have the folder."""
        self._unlock()

    def _refuse_remains(self, allowed: bool) -> None:
        """Raise UsageError if remains of a killed run would be deleted unasked."""
        left = [name for name in self._names() if not name.startswith(".")]
        if left and not allowed:
            raise UsageError(
                f"{self.path} holds remains of a killed run ({', '.join(sorted(left))}) "
                f"without its {RUN_FILE}; --force starts it again"
            )

    def _clear(self) -> None:
        """Remove what a run before this one made."""
        for name in (PROGRESS_FILE, EPISODES_FILE, POLICY_FILE, CONTRACT_FILE):
            (self.path / name).unlink(missing_ok=True)

    def write_run(self, status: str, reason: str = "", **fields: object) -> dict:
        """Write run.json; returns its contents."""
        run = {
            "schema": SCHEMA,
            "status": status,
            "reason": reason,
            "spec": dataclasses.asdict(self._run),
            "digest": self._run.digest,
            "spec_digest": self._run.world().digest,
            "scores": None,
            "steps": 0,
            "wall_s": 0.0,
            "env_steps_per_s": 0.0,
            "policy_sha256": None,
            "hyperparameters": None,
            "provenance": provenance(),
            **fields,
        }
        write_atomically(self.path / RUN_FILE, json.dumps(run, indent=2, allow_nan=False) + "\n")
        return run

    def checkpoint(self) -> tuple[int, Path | None]:
        """Iterations at the last checkpoint and its file; (0, None) without one."""
        found = {}
        for file in self.path.iterdir():
            if match := _CHECKPOINT.fullmatch(file.name):
                found[int(match.group(1))] = file
        return max(found.items(), default=(0, None))

    def checkpoint_path(self, iterations: int) -> Path:
        """Path of the checkpoint after this number of iterations."""
        return self.path / f"checkpoint-{iterations}.pt"

    def drop_checkpoints(self, keep: Path | None = None) -> None:
        """Remove all checkpoints but one."""
        for file in self.path.iterdir():
            if _CHECKPOINT.fullmatch(file.name) and file != keep:
                file.unlink()

    def progress(self, up_to_steps: int) -> list[dict]:
        """Rows of progress.csv up to a checkpoint; raises CommandError if the file is damaged."""
        path = self.path / PROGRESS_FILE
        if not path.exists():
            return []
        try:
            with path.open(newline="") as file:
                rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
            return [row for row in rows if row["steps"] <= up_to_steps]
        except (ValueError, KeyError, TypeError) as error:
            raise CommandError(
                f"{path} is damaged: {error}; --force starts the run again"
            ) from error

    def write_progress(self, rows: list[dict]) -> None:
        """Write the learning curve."""
        lines = [",".join(_COLUMNS)]
        lines += [
            ",".join(f"{row[c]:.6g}" if c != "steps" else str(int(row[c])) for c in _COLUMNS)
            for row in rows
        ]
        write_atomically(self.path / PROGRESS_FILE, "\n".join(lines) + "\n")


def progress_row(progress: Progress, steps: int, wall_s: float) -> dict:
    """A row of progress.csv, rounded as it is read again."""
    row = {**dataclasses.asdict(progress), "wall_s": wall_s}
    return {name: float(f"{value:.6g}") for name, value in row.items()} | {"steps": steps}
