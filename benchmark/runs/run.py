"""A run: train, evaluate, write the run folder, return the row."""

import contextlib
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from backends.shard import WorkerError
from baselines.baseline import Progress
from baselines.saved import POLICY_FILE, PolicyError, file_sha256
from benchmark.console import Bar, warn
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import usable_cores
from benchmark.runs.evaluate import evaluate_run, write_episodes
from benchmark.runs.run_folder import EPISODES_FILE, RUNS, START_FILE, RunFolder
from benchmark.runs.train import Training
from benchmark.settings.run_spec import RunSpec
from tasks.batch import SimulationDivergedError

FREE_BYTES = 50_000_000
"""A run is refused if the disk of its folder has less free space than this."""
Watch = Callable[[Progress, int], None]
"""Is called after every iteration with its result and the steps so far."""


def run(
    spec: RunSpec,
    path: Path,
    workers: int,
    resume: bool = False,
    force: bool = False,
    start: Path | None = None,
    watch: Watch | None = None,
) -> dict:
    """Run or continue `spec` in the folder `path`; returns its run.json.

    `start` is the folder of the policy that training starts from, if the spec has one. `watch` is
    called after every iteration with the steps so far.

    A run that diverges or cannot be done here is recorded as such before the error is raised.
    """
    with contextlib.closing(RunFolder(path, spec)) as folder:
        finished = folder.claim(resume, force)
        if finished is not None:
            warn(f"{path} is finished already; this is its row (--force trains again)")
            return finished
        _refuse_full_disk(path)
        if start is not None and not (path / START_FILE).exists():
            _copy_start(start, path)
        return _recorded(spec, folder, workers, watch)


def _recorded(spec: RunSpec, folder: RunFolder, workers: int, watch: Watch | None) -> dict:
    """Run, and write into the folder what stops it; raises CommandError."""
    try:
        registry.load("backend", spec.backend)
        baseline = registry.load("algo", spec.algo)
    except CommandError as error:
        folder.write_run("skipped", str(error))
        raise
    try:
        return _train_and_evaluate(spec, folder, baseline, workers, watch)
    except PolicyError as error:
        folder.write_run("skipped", str(error))
        raise UsageError(str(error)) from error
    except SimulationDivergedError as error:
        reason = f"{spec.backend}: {error}"
        folder.write_run("diverged", reason)
        raise CommandError(f"diverged, {reason}; recorded in {folder.path}") from error
    except WorkerError as error:
        reason = f"{spec.backend}: {error}"
        folder.write_run("interrupted", reason)
        raise CommandError(f"{reason}; --resume continues the run") from error


def _train_and_evaluate(
    spec: RunSpec,
    folder: RunFolder,
    baseline: Any,
    workers: int,
    watch: Watch | None,
) -> dict:
    steps, wall_s = 0, 0.0
    if baseline.trains:
        with Bar(f"train {spec.backend} {spec.task}", spec.steps) as bar:

            def report(progress: Progress, done: int) -> None:
                note = f"reward {progress.reward:.2f} error {progress.p_err_cm:.2f}cm"
                bar.update(done, f"{note} {progress.q_err_deg:.1f}deg")
                if watch is not None:
                    watch(progress, done)

            training = Training(spec, folder, baseline, workers, report)
            training.finish()
            steps, wall_s = training.steps, training.wall_s
    began = time.monotonic()
    episodes = evaluate_run(spec, folder.path, workers)
    rate = steps / wall_s if wall_s > 0 else 0.0
    scores = episodes.scores()
    write_episodes(episodes, folder.path / EPISODES_FILE)
    policy = folder.path / POLICY_FILE
    finished = folder.write_run(
        "done",
        scores=scores,
        steps=steps,
        wall_s=round(wall_s + time.monotonic() - began, 2),
        env_steps_per_s=round(rate, 1),
        policy_sha256=file_sha256(policy) if policy.exists() else None,
        hyperparameters=_hyperparameters(spec, baseline),
    )
    folder.drop_checkpoints()
    return finished


def row_of_run(
    spec: RunSpec,
    path: Path | None,
    workers: int | None,
    resume: bool,
    force: bool,
    start: Path | None,
    logger: str | None,
) -> dict:
    """Run or continue `spec` and return its row; `logger` has it log to TensorBoard, too."""
    path = path or RUNS / spec.name
    workers = workers or usable_cores()
    if logger is None:
        return row(run(spec, path, workers, resume, force, start), path)
    from benchmark.runs.tensorboard import Events

    with contextlib.closing(Events(path)) as events:
        return row(run(spec, path, workers, resume, force, start, events.add), path)


def row(run_json: dict, path: Path) -> dict:
    """The row that `bench run` prints for a finished run."""
    scores = run_json["scores"] or {}
    spec = run_json["spec"]
    named = {k: spec[k] for k in ("backend", "task", "algo", "observation", "effects", "seed")}
    return {
        "status": run_json["status"],
        **named,
        **{k: scores.get(k) for k in ("p_err_cm", "q_err_deg", "held", "tracked", "episodes")},
        "steps": run_json.get("steps"),
        "wall_s": run_json.get("wall_s"),
        "env_steps_per_s": run_json.get("env_steps_per_s"),
        "dir": str(path),
        "smoke": spec["smoke"],
        "digest": run_json["digest"],
        "spec_digest": run_json["spec_digest"],
    }


def _hyperparameters(spec: RunSpec, baseline: Any) -> dict[str, Any] | None:
    """All hyperparameters of the learner; None if nothing is learned."""
    return asdict(baseline.hyperparameters(**spec.overrides)) if baseline.trains else None


def _copy_start(run: Path, path: Path) -> None:
    """Copy the policy that training starts from into the folder."""
    temporary = path / f".{START_FILE}.tmp"
    shutil.copyfile(run / POLICY_FILE, temporary)
    temporary.replace(path / START_FILE)


def _refuse_full_disk(path: Path) -> None:
    free = shutil.disk_usage(path).free
    if free < FREE_BYTES:
        raise CommandError(
            f"the disk of {path} has {free / 1e6:.0f} MB left; a run needs "
            f"{FREE_BYTES / 1e6:.0f} MB: "
            "free some space or choose another --out"
        )
