"""A policy replayed in its fixed evaluation episodes, and what a picture needs of them kept."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.shard import WorkerError
from backends.spec import Spec
from backends.state import Array, State
from baselines.saved import PolicyError
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.evaluate import evaluate
from benchmark.run import _actor
from benchmark.run_spec import RunSpec, _within, make_env
from tasks.batch import BatchEnv, SimulationDivergedError, Step
from tasks.task import EPISODE_S

_LAPS = ("circle",)
"""Tasks that repeat one closed lap: their entry is left out, as in the paper's figure."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """T policy steps of E episodes."""

    spec: Spec
    """The world that was simulated."""
    first: int
    """Step from which the figure is drawn."""
    lower_m: Array
    """Lower end of the stick [m], world frame, shape (T, E, 3)."""
    reference_m: Array
    """Drawn point [m], world frame, shape (T, E, 3)."""
    held: Array
    """Whether the stick has not fallen so far, shape (T, E), bool."""
    moment: int
    """The step whose state was kept."""
    state: State
    """Episode 0 at that step: arrays of one world."""
    scores: dict[str, float]
    """Means over these episodes, and their count."""


class _Recorder:
    """Copies what a recording holds, step by step."""

    def __init__(self, moment: int, bar: Bar) -> None:
        self.moment, self._bar = moment, bar
        self.state: State | None = None
        self.lower_m: list[Array] = []
        self.reference_m: list[Array] = []
        self.fallen: list[Array] = []

    def __call__(self, env: BatchEnv, step: Step) -> None:
        if len(self.lower_m) == self.moment:
            self.state = _first_world(env.state)
        self.lower_m.append(env.lower_end())
        self.reference_m.append(env.reference()[0])
        self.fallen.append(step.terminated)
        self._bar.update(len(self.lower_m))


def replay(run: RunSpec, policy: Path, episodes: int, time_s: float, workers: int) -> Recording:
    """Evaluate the policy in a folder; `time_s` is the moment whose state is kept [s].

    Raises UsageError when the policy does not fit, CommandError when the simulation stops.
    """
    world = run.world()
    _within("--time", time_s, world.timing.policy_s, EPISODE_S)
    moment = round(time_s / world.timing.policy_s) - 1
    env = make_env(run, [world] * episodes, seed=0, workers=workers)
    try:
        with Bar(f"replay {run.backend} {run.task}", env.horizon) as bar:
            recorder = _Recorder(moment, bar)
            scores = evaluate(env, _actor(run, policy, env), recorder).scores()
        return _recording(world, recorder, scores, _first_drawn(run, env))
    except PolicyError as error:
        raise UsageError(str(error)) from error
    except (SimulationDivergedError, WorkerError) as error:
        raise CommandError(f"the replay on {run.backend} stopped: {error}") from error
    finally:
        env.close()


def _recording(world: Spec, recorder: _Recorder, scores: dict, first: int) -> Recording:
    assert recorder.state is not None
    return Recording(
        spec=world,
        first=first,
        lower_m=np.stack(recorder.lower_m),
        reference_m=np.stack(recorder.reference_m),
        held=~np.logical_or.accumulate(np.stack(recorder.fallen)),
        moment=recorder.moment,
        state=recorder.state,
        scores=scores,
    )


def _first_drawn(run: RunSpec, env: BatchEnv) -> int:
    """The step at which the second lap begins, where a task has laps and the episode two."""
    lap_s = 2 * math.pi / env.task.rate_rad_s
    has_two = run.task in _LAPS and 2 * lap_s <= EPISODE_S
    return round(lap_s / env.policy_s) if has_two else 0


def _first_world(state: State) -> State:
    one = state.rows(slice(0, 1))
    return State(**{f.name: getattr(one, f.name).copy() for f in dataclasses.fields(one)})
