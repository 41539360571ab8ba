"""Training as a chain of segments, each starting from a file, so that a kill changes nothing."""

import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from baselines.baseline import Learner, Progress
from baselines.saved import POLICY_FILE, write_contract
from benchmark import registry
from benchmark.errors import CommandError
from benchmark.run_folder import RunFolder, progress_row
from benchmark.run_spec import RunSpec, make_env, training_worlds

SEGMENT_ITERATIONS, SMOKE_SEGMENT_ITERATIONS = 20, 2


def segment_seed(run: RunSpec, segment: int) -> int:
    """The seed of one segment: a hash, so that neighbouring seeds share no stream."""
    return int(np.random.SeedSequence([run.seed, segment]).generate_state(1)[0])


def train(
    run: RunSpec, folder: RunFolder, workers: int, report: Callable[[Progress, int], None]
) -> tuple[int, float]:
    """Train from the last checkpoint to the end; environment steps and wall seconds in all.

    Writes a checkpoint and the learning curve after each segment and the policy at the end.
    """
    per_segment = SMOKE_SEGMENT_ITERATIONS if run.smoke else SEGMENT_ITERATIONS
    iterations, checkpoint = folder.checkpoint()
    total, per_iteration = None, None
    rows: list[dict] = []
    started = time.monotonic()
    while total is None or iterations < total:
        segment = iterations // per_segment
        env = make_env(
            run, training_worlds(run, segment), segment_seed(run, segment), workers
        )
        try:
            learner: Learner = registry.load("algorithm", run.algo)(
                env, segment_seed(run, segment)
            )
            if total is None or per_iteration is None:
                per_iteration = learner.steps_per_iteration
                total = max(1, math.ceil(run.steps / per_iteration))
                rows = folder.progress(iterations * per_iteration)
                started -= rows[-1]["wall_s"] if rows else 0.0
            if checkpoint is not None:
                _load(learner, checkpoint)

            def note(progress: Progress) -> None:
                steps = int(rows[-1]["steps"]) if rows else 0
                rows.append(
                    progress_row(progress, steps + progress.steps, time.monotonic() - started)
                )
                report(progress, int(rows[-1]["steps"]))

            count = min(per_segment, total - iterations)
            learner.learn(count, note)
            iterations += count
            checkpoint = _save(learner, folder, iterations)
            folder.write_progress(rows)
            if iterations >= total:
                write_contract(folder.path, env.observation)
                learner.export(folder.path / POLICY_FILE)
        finally:
            env.close()
    return iterations * (per_iteration or 0), rows[-1]["wall_s"] if rows else 0.0


def _load(learner: Learner, checkpoint: Path) -> None:
    try:
        learner.load(checkpoint)
    except Exception as error:  # noqa: BLE001 - torch raises many classes for a damaged file
        raise CommandError(
            f"{checkpoint} cannot be read ({type(error).__name__}); "
            "remove it to resume at an earlier one, or --force to start anew"
        ) from error


def _save(learner: Learner, folder: RunFolder, iterations: int) -> Path:
    path = folder.checkpoint_path(iterations)
    temporary = path.with_name(f".{path.name}.tmp")
    learner.save(temporary)
    os.replace(temporary, path)
    folder.drop_checkpoints(keep=path)
    return path
