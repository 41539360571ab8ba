"""A policy replayed in its fixed evaluation episodes, and what a picture needs of them kept."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.spec import Spec
from backends.state import Array, State
from benchmark import registry
from benchmark.run import deploy
from benchmark.run_spec import RunSpec, within
from tasks.batch import BatchEnv, Step
from tasks.task import EPISODE_S, RATE_RAD_S


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

    def __init__(self, moment: int) -> None:
        self.moment = moment
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


def replay(run: RunSpec, policy: Path, episodes: int, time_s: float, workers: int) -> Recording:
    """Evaluate the policy in a folder; `time_s` is the moment whose state is kept [s].

    Raises UsageError when the policy does not fit, CommandError when the simulation stops.
    """
    world = run.world()
    within("--time", time_s, world.timing.policy_s, EPISODE_S)
    recorder = _Recorder(round(time_s / world.timing.policy_s) - 1)
    played = deploy(run, policy, workers, episodes=episodes, watch=recorder)
    return _recording(run, recorder, played.scores())


def _recording(run: RunSpec, recorder: _Recorder, scores: dict) -> Recording:
    assert recorder.state is not None
    return Recording(
        spec=run.world(),
        first=_first_drawn(run),
        lower_m=np.stack(recorder.lower_m),
        reference_m=np.stack(recorder.reference_m),
        held=~np.logical_or.accumulate(np.stack(recorder.fallen)),
        moment=recorder.moment,
        state=recorder.state,
        scores=scores,
    )


def _first_drawn(run: RunSpec) -> int:
    """Leave out the first lap of a figure that repeats, as the paper does, where two fit."""
    lap_s = 2 * math.pi / (run.speed * RATE_RAD_S)
    has_two = registry.load("task", run.task).repeats and 2 * lap_s <= EPISODE_S
    return round(lap_s / run.world().timing.policy_s) if has_two else 0


def _first_world(state: State) -> State:
    one = state.rows(slice(0, 1))
    return State(**{f.name: getattr(one, f.name).copy() for f in dataclasses.fields(one)})
