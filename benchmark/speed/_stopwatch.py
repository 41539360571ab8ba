"""Time an environment as training steps it, and its bare engine through the same steps.

Worlds are at all phases of their episodes, and actions are those of an untrained policy. The bare
engine has worlds of its own, which start where the environment's start. After each step of the
environment it takes the same steps of physics, under the joint torques of that step, and must end
in the same place. How long that takes depends on how fast the machine was at that moment, but the
ratio of the two does not. Where its worlds lie in memory makes an engine quicker or slower by some
per cent as well, so halfway the two change places.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from backends.engine import Engine, Simulator
from backends.shard import Sharded
from backends.state import Array, InitialState, State
from tasks.batch import BatchEnv

ACTION_STD = 0.4
"""Standard deviation of the actions, as learners begin with."""
SETTLE_STEPS = 20
"""Steps before those that are timed, in which all worlds close their first grasp."""
STRETCH = 24
"""Steps over which a ratio is taken: new episodes come in some of them only."""
Clock = Callable[[], float]
"""A clock in seconds: CPU time or wall time."""


class DifferentStepsError(Exception):
    """The bare engine did not end where the environment did."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Times for one policy period of all worlds [s], means over the steps."""

    step_s: float
    """An environment step: drives, engine, touch, observation, reward."""
    restart_s: float
    """New episodes, per step."""
    wall_s: float
    """Both, in wall time, whichever clock the others use."""
    advance_s: float
    """The part of a step that drives and engine take, with reading joints, stick and contacts."""
    raw_s: float
    """The bare engine through the same steps."""
    overhead: tuple[float, float, float]
    """Quartiles over the stretches of (step + restart) / raw - 1, the median in the middle."""
    steps: int


class _Step(NamedTuple):
    """The times of a step as in `Timing` [s]."""

    step_s: float
    restart_s: float
    wall_s: float
    advance_s: float
    raw_s: float


def measure(
    env: BatchEnv, bare: Simulator, seconds: float, clock: Clock = time.perf_counter
) -> Timing:
    """Time an environment and a second engine with the same worlds, for about `seconds`.

    Raises DifferentStepsError.
    """
    stepped = env.simulator
    pairs = (stepped, bare), (bare, stepped)
    try:
        return _summary(*(_half(env, *pair, seconds / 2, clock) for pair in pairs))
    finally:
        env.simulator = stepped  # whoever made an engine closes it


def _half(
    env: BatchEnv, stepped: Simulator, bare: Simulator, seconds: float, clock: Clock
) -> Array:
    """Times (steps, 5) of an environment that steps one engine, beside another as the bare one."""
    assert isinstance(stepped, Engine | Sharded) and isinstance(bare, Engine | Sharded)
    env.simulator = timed = _Timed(stepped, clock)
    actions, steps = _actions(env), list[_Step]()
    env.reset(stagger=True)
    timed.start(bare)
    for _ in range(SETTLE_STEPS):
        _step(env, timed, bare, next(actions))
    began = time.perf_counter()
    while len(steps) < STRETCH or time.perf_counter() - began < seconds:
        steps.append(_step(env, timed, bare, next(actions)))
    return np.array(steps)


class _Timed:
    """A simulator that takes the time of its `advance` and remembers its last start."""

    def __init__(self, simulator: Engine | Sharded, clock: Clock) -> None:
        self.specs, self.close = simulator.specs, simulator.close
        self.simulator, self.clock, self.seconds = simulator, clock, 0.0

    def reset(self, initial: InitialState, mask: Array) -> State:
        """See `Simulator.reset`."""
        self._start = initial, mask
        return self.simulator.reset(initial, mask)

    def start(self, bare: Engine | Sharded) -> None:
        """Start the worlds of another engine as these were last started."""
        bare.reset(*self._start)

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """See `Simulator.advance`."""
        began = self.clock()
        state = self.simulator.advance(target_rad, load_nm, pull_n)
        self.seconds = self.clock() - began
        return state


def _actions(env: BatchEnv) -> Iterator[Array]:
    rng = np.random.default_rng(0)
    while True:
        drawn = rng.normal(0.0, ACTION_STD, (env.worlds, env.action_width))
        yield np.clip(drawn, -1.0, 1.0)


def _step(env: BatchEnv, timed: _Timed, bare: Engine | Sharded, action: Array) -> _Step:
    """Time a step as `BatchEnv.step_and_restart` takes it, and the same of the bare engine.

    New episodes begin at once, as in training, and not after the bare engine has filled the caches.
    """
    clock = timed.clock
    began, wall = clock(), time.perf_counter()
    step = env.step(action)
    step_s, wall_s = clock() - began, time.perf_counter() - wall
    ended = env.state.joint_rad.copy()
    began, wall = clock(), time.perf_counter()
    restarts = step.done.any()
    if restarts:
        env.reset(step.done)
    restart_s, wall_s = clock() - began, wall_s + time.perf_counter() - wall
    began = clock()
    bare.rollout(timed.simulator.applied_nm)
    raw_s = clock() - began
    if not np.array_equal(bare.state.joint_rad, ended):
        raise DifferentStepsError("the bare engine did not end where the environment did")
    if restarts:
        timed.start(bare)
    return _Step(step_s, restart_s, wall_s, timed.seconds, raw_s)


def _summary(*halves: Array) -> Timing:
    """Means over all steps, and quartiles of ratios, each of a stretch of both halves."""
    count = min(map(len, halves)) // STRETCH
    split = (np.array_split(half, count) for half in halves)
    stretches = [_Step(*np.concatenate(pair).sum(axis=0)) for pair in zip(*split, strict=True)]
    overhead = [(s.step_s + s.restart_s) / s.raw_s - 1.0 for s in stretches]
    low, middle, high = np.percentile(overhead, [25, 50, 75]).tolist()
    steps = np.concatenate(halves)
    means = _Step(*steps.mean(axis=0).tolist())
    return Timing(**means._asdict(), overhead=(low, middle, high), steps=len(steps))
