"""Replay a policy in its fixed evaluation episodes and keep the data for pictures."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.spec import Spec
from backends.state import Array, State
from backends.touch import Skin, Touch
from benchmark.parts import registry
from benchmark.runs.evaluate import deploy
from benchmark.settings.run_spec import RunSpec
from tasks.batch import BatchEnv, Step
from tasks.task import EPISODE_S, RATE_RAD_S


@dataclass(frozen=True, kw_only=True)
class Recording:
    """T policy steps of E episodes; joints and touch are kept for the first one only."""

    spec: Spec
    """The world that was simulated."""
    first: int
    """First step of the drawn figure."""
    lap: int
    """Steps of one lap, or of the whole episode if the figure does not repeat."""
    period: int
    """Steps in which the figure's phase goes round."""
    time_s: Array
    """Time since the start after each step [s], shape (T,)."""
    lower_m: Array
    """Lower end of the stick [m], world frame, shape (T, E, 3)."""
    reference_m: Array
    """Drawn point [m], world frame, shape (T, E, 3)."""
    held: Array
    """Whether the stick has not fallen so far, shape (T, E), bool."""
    target_rad: Array
    """Commanded joint angles of episode 0 [rad], shape (T, J)."""
    states: State
    """Episode 0, with steps in place of worlds: arrays (T, ...)."""
    touch: Touch
    """Touch readings of episode 0: arrays (T, ...)."""
    scores: dict[str, float]
    """Means over these episodes, and their count."""


class _Recorder:
    """Copies the data of a recording, step by step."""

    def __init__(self) -> None:
        self.states: list[State] = []
        self.signals: dict[str, list[Array]] = {}

    def __call__(self, env: BatchEnv, step: Step) -> None:
        self.states.append(_first_world(env.state))
        seen = {
            "time_s": env.time_s[0].copy(),
            "lower_m": env.lower_end(),
            "reference_m": env.reference()[0],
            "target_rad": env.target_rad[0].copy(),
            "fallen": step.terminated,
        }
        for name, value in seen.items():
            self.signals.setdefault(name, []).append(value)


def replay(run: RunSpec, policy: Path, episodes: int, workers: int) -> Recording:
    """Replay and evaluate the policy in a folder.

    Raises UsageError if the policy does not fit, CommandError if the simulation stops.
    """
    recorder = _Recorder()
    played = deploy(run, policy, workers, episodes=episodes, watch=recorder)
    signals = {name: np.stack(values) for name, values in recorder.signals.items()}
    world, states = run.world(), _as_worlds(recorder.states)
    first, lap, period = _laps(run)
    return Recording(
        spec=world,
        first=first,
        lap=lap,
        period=period,
        held=~np.logical_or.accumulate(signals.pop("fallen")),
        states=states,
        touch=Skin([world] * len(recorder.states)).feel(states, signals["time_s"]),
        scores=played.scores(),
        **signals,
    )


def _laps(run: RunSpec) -> tuple[int, int, int]:
    """Steps before the drawn part, steps of a lap, and steps in which the phase goes round.

    As in the paper, the first lap of a repeating figure is left out if there are two.
    """
    policy_s = run.world().timing.policy_s
    lap_s = 2 * math.pi / (run.speed * RATE_RAD_S)
    period = round(lap_s / policy_s)
    if registry.load("task", run.task).repeats and 2 * lap_s <= EPISODE_S:
        return period, period, period
    return 0, round(EPISODE_S / policy_s), period


def _first_world(state: State) -> State:
    one = state.rows(slice(0, 1))
    return State(**{f.name: getattr(one, f.name).copy() for f in dataclasses.fields(one)})


def _as_worlds(states: list[State]) -> State:
    names = [field.name for field in dataclasses.fields(State)]
    return State(**{name: np.concatenate([getattr(s, name) for s in states]) for name in names})
