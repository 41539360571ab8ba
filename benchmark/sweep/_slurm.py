"""Run cells of a sweep as jobs of a Slurm cluster, through submitit, with the same function.

A cell's job number is stored next to its log. So the same command, given again, waits for jobs that
are still queued instead of submitting them twice.
"""

import contextlib
import math
import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import submitit
from submitit.core.utils import FailedJobError, FailedSubmissionError, UncompletedJobError

from benchmark.console import say
from benchmark.errors import CommandError
from benchmark.sweep._board import Board
from benchmark.sweep._cell import LOGS, Cell, Outcome, run_cell
from benchmark.sweep._grid import Slurm
from files.atomic import write_atomically

MARGIN_MIN = 5
"""Slurm's time limit is longer than the cell's own by this, so that the cell can report why it
stopped [min]."""
POLL_S = 5.0
GONE_S = 60.0
"""A job without a result counts as lost this long after it left the queue [s], because shared disks
lag."""


@dataclass(frozen=True, kw_only=True)
class _Job:
    """A cell in the queue."""

    cell: Cell
    job: submitit.Job[Outcome]


def run_on_slurm(board: Board, limit_s: float, jobs: int | None, slurm: Slurm) -> None:
    """Submit the unfinished cells of a sweep and wait for them; at most `jobs` run at a time.

    After Ctrl-C the jobs stay in the queue.
    """
    if shutil.which("sbatch") is None:
        raise CommandError(
            "--slurm needs Slurm's sbatch, which is not on this machine; "
            "run this on a login node of the cluster, or leave --slurm out"
        )
    folder = board.out / LOGS / "slurm"
    waiting = _earlier(board.open, folder)
    queued = [item.cell for item in waiting]
    if waiting:
        say(f"waiting for {len(waiting)} jobs of an earlier call")
    new = [cell for cell in board.open if cell not in queued]
    if new:
        waiting += _submit(new, folder, limit_s, jobs or len(new), slurm)
    try:
        _wait(board, waiting)
    except KeyboardInterrupt:
        ids = " ".join(sorted({item.job.job_id.split("_")[0] for item in waiting}))
        say(f"the jobs stay queued: the same command waits for them again, scancel {ids} ends")
        raise


def _submit(
    cells: Sequence[Cell], folder: Path, limit_s: float, jobs: int, slurm: Slurm
) -> list[_Job]:
    options = {name: value for name, value in slurm.options.items() if value is not False}
    named = {"partition": slurm.partition, "account": slurm.account}
    executor = submitit.AutoExecutor(folder=folder, cluster="slurm")
    executor.update_parameters(
        name="stickbench",
        timeout_min=math.ceil(limit_s / 60) + MARGIN_MIN,
        cpus_per_task=slurm.cpus,
        mem_gb=slurm.memory_gb,
        slurm_array_parallelism=jobs,
        slurm_setup=slurm.setup,
        slurm_srun_args=[f"--cpus-per-task={slurm.cpus}"],  # Slurm 22.05 and later hand on none
        slurm_additional_parameters=options,
        **{f"slurm_{name}": value for name, value in named.items() if value is not None},
    )
    try:
        with executor.batch():
            given = [executor.submit(run_cell, cell, limit_s, slurm.cpus) for cell in cells]
    except (FailedJobError, FailedSubmissionError) as error:
        raise CommandError(f"sbatch refused the jobs: {' '.join(str(error).split())}") from error
    for cell, job in zip(cells, given, strict=True):
        write_atomically(_number_file(cell, folder), job.job_id + "\n")
    ids = " ".join(sorted({job.job_id.split("_")[0] for job in given}))
    say(f"submitted {len(given)} cells as job {ids}")
    return [_Job(cell=cell, job=job) for cell, job in zip(cells, given, strict=True)]


def _earlier(cells: Sequence[Cell], folder: Path) -> list[_Job]:
    """The cells of an earlier call that are still in the queue."""
    queue = _queue()
    found = []
    for cell in cells:
        with contextlib.suppress(FileNotFoundError):
            number = _number_file(cell, folder).read_text().strip()
            if queue is None:
                raise CommandError(
                    "squeue does not answer, and cells may still be queued; try again later"
                )
            if number in queue:
                found.append(_Job(cell=cell, job=submitit.SlurmJob(folder, number)))
    return found


def _number_file(cell: Cell, folder: Path) -> Path:
    return folder / f"{cell.spec.name}.job"


def _wait(board: Board, waiting: list[_Job]) -> None:
    """Record the outcome of each job that has left the queue.

    Files of a job that is still queued are from an attempt before Slurm restarted it.
    """
    gone_s: dict[str, float] = {}
    while waiting:
        queue = _queue()
        for item in list(waiting):
            if queue is None or item.job.job_id in queue:
                if item.cell.log.exists():
                    board.beat(item.cell)
            elif outcome := _result(item) or _lost(item, gone_s):
                board.ended(outcome)
                waiting.remove(item)
        if waiting:
            time.sleep(POLL_S)


def _lost(item: _Job, gone_s: dict[str, float]) -> Outcome | None:
    """The outcome 'lost' once a job has been gone for GONE_S; `gone_s` keeps the time."""
    now_s = time.monotonic()
    if now_s < gone_s.setdefault(item.job.job_id, now_s) + GONE_S:
        return None
    where = f"job {item.job.job_id} left the queue without a result"
    reason = f"{where}; see {item.job.paths.stderr}"
    return Outcome(name=item.cell.spec.name, state="crashed", reason=reason)


def _result(item: _Job) -> Outcome | None:
    """The result of a job; None while there is none."""
    if not item.job.paths.result_pickle.exists():
        return None
    try:
        return item.job.result()
    except UncompletedJobError as error:
        reason = f"{str(error).strip().splitlines()[-1]}; see {item.job.paths.stderr}"
        return Outcome(name=item.cell.spec.name, state="crashed", reason=reason)


def _queue() -> set[str] | None:
    """Numbers of the user's jobs in the queue or running; None if Slurm does not answer."""
    command = ["squeue", "--noheader", "--array", "--format=%i", f"--user={os.getuid()}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return set(done.stdout.split()) if done.returncode == 0 else None
