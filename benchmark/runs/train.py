"""Training as a chain of segments that each start from a file, so that a kill changes nothing."""

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from backends.randomize import randomize
from backends.spec import Spec
from baselines.baseline import Learner, Progress
from baselines.saved import POLICY_FILE, write_contract
from benchmark.errors import CommandError
from benchmark.runs.run_folder import START_FILE, RunFolder, progress_row
from benchmark.settings.run_spec import RunSpec
from leaderboard.identity import CONVERGED
from tasks.batch import BatchEnv

SEGMENT_ITERATIONS, SMOKE_SEGMENT_ITERATIONS = 20, 1
"""Iterations between two checkpoints."""


WINDOW, LEAST, FIRST, RISE = 0.2, 20, 10, 0.02
"""A curve has converged whose last share of iterations, at least so many, is above those before by
less than the share RISE of what it has risen since its first iterations."""


def converged(rewards: Sequence[float]) -> bool:
    """Whether a learning curve, a reward per iteration, rises no more."""
    width = max(LEAST, int(WINDOW * len(rewards)))
    if len(rewards) < FIRST + 2 * width:
        return False
    late, before = np.mean(rewards[-width:]), np.mean(rewards[-2 * width : -width])
    return bool(late - before < RISE * (late - np.mean(rewards[:FIRST])))


def segment_seed(run: RunSpec, segment: int) -> int:
    """The seed of one segment: a hash, so that neighbouring seeds have independent streams."""
    return int(np.random.SeedSequence([run.seed, segment]).generate_state(1)[0])


def training_worlds(run: RunSpec, segment: int) -> list[Spec]:
    """The worlds of one training segment: newly drawn, or all nominal."""
    nominal = run.world()
    if not run.randomize:
        return [nominal] * run.worlds
    rng = np.random.default_rng([run.seed, segment])
    return [randomize(nominal, run.drawn, rng) for _ in range(run.worlds)]


class Training:
    """The training of one run, from the last checkpoint in its folder to the end."""

    def __init__(
        self,
        run: RunSpec,
        folder: RunFolder,
        learner: Any,
        workers: int,
        report: Callable[[Progress, int], None],
    ) -> None:
        self._run, self._folder, self._workers, self._report = run, folder, workers, report
        self._learner_class = learner
        self._settings = learner.hyperparameters(**run.overrides)
        self._per_iteration: int = learner.steps_per_iteration(run.worlds, self._settings)
        self._per_segment = SMOKE_SEGMENT_ITERATIONS if run.smoke else SEGMENT_ITERATIONS
        self._iterations, self._checkpoint = folder.checkpoint()
        self._rows = folder.progress(self._iterations * self._per_iteration)
        self._began = time.monotonic() - self.wall_s

    @property
    def steps(self) -> int:
        """Environment steps trained so far."""
        return self._iterations * self._per_iteration

    @property
    def wall_s(self) -> float:
        """Wall time of these steps, including earlier sessions [s]."""
        return self._rows[-1]["wall_s"] if self._rows else 0.0

    def finish(self) -> None:
        """Train to the end of the budget; then the folder holds the policy and its contract.

        Writes a checkpoint and the learning curve after each segment.
        """
        while not self._is_over:
            iterations = min(self._per_segment, self._total - self._iterations)
            with self._learner() as (learner, env):
                coming = range(self._iterations, self._iterations + iterations)
                learner.learn([number / self._total for number in coming], self._note)
                self._save(learner, self._iterations + iterations)
                if self._is_over:
                    self._export(learner, env)
        if not (self._folder.path / POLICY_FILE).exists():  # killed after the last checkpoint
            with self._learner() as (learner, env):
                self._export(learner, env)

    @property
    def _total(self) -> int:
        """Iterations of the budget."""
        return max(1, math.ceil(self._run.steps / self._per_iteration))

    @property
    def _is_over(self) -> bool:
        """Whether the budget is spent, or the curve has converged and that is the end."""
        if self._run.until == CONVERGED and converged([row["reward"] for row in self._rows]):
            return True
        return self._iterations >= self._total

    @contextmanager
    def _learner(self) -> Iterator[tuple[Learner, BatchEnv]]:
        """The learner as the last checkpoint has it, in the worlds of the segment after that."""
        index = self._iterations // self._per_segment
        seed = segment_seed(self._run, index)
        env = self._run.make_env(training_worlds(self._run, index), seed, self._workers)
        try:
            learner: Learner = self._learner_class(env, seed, self._settings)
            if self._checkpoint is not None:
                _load(learner, self._checkpoint)
            elif self._run.start_sha256 is not None:
                learner.start_from(self._folder.path / START_FILE)
            yield learner, env
        finally:
            env.close()

    def _export(self, learner: Learner, env: BatchEnv) -> None:
        """Write the contract, then the policy: where there is a policy, both are whole."""
        write_contract(self._folder.path, env.observation)
        path = self._folder.path / POLICY_FILE
        temporary = path.with_name(f".{path.name}.tmp")
        learner.export(temporary)
        os.replace(temporary, path)

    def _note(self, progress: Progress) -> None:
        steps = int(self._rows[-1]["steps"]) if self._rows else 0
        wall_s = time.monotonic() - self._began
        self._rows.append(progress_row(progress, steps + progress.steps, wall_s))
        self._report(progress, steps + progress.steps)

    def _save(self, learner: Learner, iterations: int) -> None:
        path = self._folder.checkpoint_path(iterations)
        temporary = path.with_name(f".{path.name}.tmp")
        try:
            learner.save(temporary)
        except RuntimeError as error:  # torch's word for a disk that is full
            temporary.unlink(missing_ok=True)
            raise CommandError(
                f"{path} cannot be written ({error}); the last checkpoint is kept: "
                "free some space, then --resume"
            ) from error
        self._folder.write_progress(self._rows)
        os.replace(temporary, path)
        self._iterations, self._checkpoint = iterations, path
        self._folder.drop_checkpoints(keep=path)


def _load(learner: Learner, checkpoint: Path) -> None:
    try:
        learner.load(checkpoint)
    except Exception as error:  # noqa: BLE001 - torch raises many classes for a damaged file
        raise CommandError(
            f"{checkpoint} cannot be read ({type(error).__name__}: {error}); "
            "--force starts the run again"
        ) from error
