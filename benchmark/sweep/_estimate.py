"""Estimate the duration of a sweep's cells from short measurements on this machine."""

import heapq
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from backends.state import Array
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.runs.plan import plan
from benchmark.runs.run_folder import RunFolder
from benchmark.runs.train import training_worlds
from benchmark.settings.run_spec import RunSpec
from benchmark.sweep._cell import Cell
from leaderboard.identity import EPISODES, SMOKE_EPISODES
from tasks.batch import BatchEnv, Step
from tasks.task import EPISODE_S

START_S = 10.0
"""Time for a cell's imports and the export of its policy [s]; short compared with a real run."""


@dataclass(frozen=True, kw_only=True)
class Rates:
    """Measured rates of one core of this machine."""

    steps_per_s: dict[str, float]
    """Environment steps simulated per second, by backend."""
    learning_s: dict[tuple[str, str], float]
    """Time for learning, without simulation, per environment step [s], by algorithm and
    observation."""
    problems: dict[str, str]
    """The reason why a backend could not be measured, by backend."""

    def seconds(self, cell: Cell) -> float | None:
        """Remaining time of a cell on one core; None if its engine was not measured."""
        spec = cell.spec
        rate = self.steps_per_s.get(spec.backend)
        if rate is None:
            return None
        horizon = round(EPISODE_S / spec.world().timing.policy_s)
        evaluation = (SMOKE_EPISODES if spec.smoke else EPISODES) * horizon
        steps = max(0, spec.steps - _trained(cell))
        learning_s = steps * self.learning_s.get((spec.algo, spec.observation), 0.0)
        return START_S + (steps + evaluation) / rate + learning_s


def measure(specs: Sequence[RunSpec]) -> Rates:
    """Simulate briefly with every backend, and learn once with every algorithm and observation."""
    rates, problems = {}, {}
    for spec in _first(specs, lambda spec: spec.backend):
        try:
            measured = plan(spec, None, workers=1)
            rates[spec.backend] = measured["measured_env_steps_per_s"]
        except CommandError as error:
            problems[spec.backend] = str(error)
    fast = sorted(
        (s for s in specs if s.backend in rates and registry.load("algo", s.algo).trains),
        key=lambda spec: -rates[spec.backend],
    )
    learning = {
        (spec.algo, spec.observation): _learning_s(spec)
        for spec in _first(fast, lambda spec: (spec.algo, spec.observation))
    }
    return Rates(steps_per_s=rates, learning_s=learning, problems=problems)


def makespan(durations: Iterable[float], jobs: int) -> float:
    """Time until the last cell ends if each starts, in order, when one of `jobs` places is free."""
    free = [0.0] * jobs
    for duration in durations:
        heapq.heapreplace(free, free[0] + duration)
    return max(free)


def _first(specs: Iterable[RunSpec], kind: Callable[[RunSpec], object]) -> list[RunSpec]:
    """The first spec of every kind."""
    found: dict[object, RunSpec] = {}
    for spec in specs:
        found.setdefault(kind(spec), spec)
    return list(found.values())


def _learning_s(spec: RunSpec) -> float:
    """Wall time of one training iteration outside the environment, per environment step [s]."""
    env = spec.make_env(training_worlds(spec, 0), seed=0, workers=1)
    try:
        kind = registry.load("algo", spec.algo)
        settings = kind.hyperparameters(**spec.overrides)
        learner = kind(env, 0, settings)
        simulated = _time_steps(env)
        began = time.monotonic()
        learner.learn([0.0], lambda progress: None)
        wall_s = time.monotonic() - began
        return (wall_s - sum(simulated)) / learner.steps_per_iteration(spec.worlds, settings)
    finally:
        env.close()


def _time_steps(env: BatchEnv) -> list[float]:
    """Make `env` append the wall time of each step [s] to the list."""
    noted: list[float] = []
    step = env.step_and_restart

    def timed(action: Array) -> tuple[Step, Array]:
        began = time.monotonic()
        stepped = step(action)
        noted.append(time.monotonic() - began)
        return stepped

    env.step_and_restart = timed  # type: ignore[method-assign]
    return noted


def _trained(cell: Cell) -> int:
    """Environment steps that are already trained in a cell's folder."""
    rows = RunFolder(cell.path, cell.spec).progress(cell.spec.steps)
    return int(rows[-1]["steps"]) if rows else 0
