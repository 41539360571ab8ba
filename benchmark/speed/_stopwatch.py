"""Time an environment as training steps it, and its bare engine, in alternating blocks.

Worlds are at all phases of their episodes, and actions are those of an untrained policy. Both step
the same worlds with the stick in the same grasp. A block depends on how fast the machine was at
that moment, but the ratio of the two does not.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from backends.engine import Simulator
from backends.state import Array, State
from tasks.batch import BatchEnv

ACTION_STD = 0.4
"""Standard deviation of the actions, as learners begin with."""
SETTLE_STEPS = 20
"""Steps before the first block, in which all worlds close their first grasp."""
ENV_STEPS = 4
"""Environment steps in a block, before one period of the bare engine."""
CHUNK = 6
"""Blocks over which a ratio is taken: new episodes come in some of them only."""
Clock = Callable[[], float]
"""A clock in seconds: CPU time or wall time."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Times for one policy period of all worlds [s], means over the blocks."""

    step_s: float
    """An environment step: drives, engine, touch, observation, reward."""
    restart_s: float
    """New episodes, per step."""
    wall_s: float
    """Both, in wall time, whichever clock the others use."""
    advance_s: float
    """The part of a step that drives and engine take, with reading joints, stick and contacts."""
    raw_s: float
    """The bare engine under constant torques."""
    overhead: tuple[float, float, float]
    """Quartiles over the chunks of (step + restart) / raw - 1, the median in the middle."""
    pressing: float
    """Share of fingertips that pressed the stick, checked in every block."""
    blocks: int


@dataclass(kw_only=True)
class _Blocks:
    """The measurements, block by block [s]."""

    step_s: list[float] = field(default_factory=list)
    restart_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    advance_s: list[float] = field(default_factory=list)
    raw_s: list[float] = field(default_factory=list)
    pressing: list[float] = field(default_factory=list)


def measure(
    env: BatchEnv, coast: Callable[[int], None], seconds: float, clock: Clock = time.perf_counter
) -> Timing:
    """Time an environment and, with `coast`, its bare engine, for about `seconds`."""
    blocks, actions = _Blocks(), _actions(env)
    env.simulator = timed = _Timed(env.simulator, clock)
    env.reset(stagger=True)
    for _ in range(SETTLE_STEPS):
        env.step_and_restart(next(actions))
    began = time.perf_counter()
    while len(blocks.raw_s) < CHUNK or time.perf_counter() - began < seconds:
        _block(env, timed, coast, actions, blocks)
    return _summary(blocks)


class _Timed:
    """A simulator that sums the time of its `advance`."""

    def __init__(self, simulator: Simulator, clock: Clock) -> None:
        self.specs, self.clock, self.seconds = simulator.specs, clock, 0.0
        self.reset, self.close, self._advance = simulator.reset, simulator.close, simulator.advance

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """See `Simulator.advance`."""
        began = self.clock()
        state = self._advance(target_rad, load_nm, pull_n)
        self.seconds += self.clock() - began
        return state


def _actions(env: BatchEnv) -> Iterator[Array]:
    rng = np.random.default_rng(0)
    while True:
        drawn = rng.normal(0.0, ACTION_STD, (env.worlds, env.action_width))
        yield np.clip(drawn, -1.0, 1.0)


def _block(
    env: BatchEnv,
    timed: _Timed,
    coast: Callable[[int], None],
    actions: Iterator[Array],
    blocks: _Blocks,
) -> None:
    """Time some steps as `BatchEnv.step_and_restart` takes them, then the bare engine from there.

    It comes right after a step, as the next step would: at rest contacts are solved faster.
    """
    clock, step_s, restart_s, wall_s = timed.clock, 0.0, 0.0, 0.0
    timed.seconds = 0.0
    for _ in range(ENV_STEPS):
        action, began_s, began = next(actions), time.perf_counter(), clock()
        step = env.step(action)
        stepped = clock()
        if step.done.any():
            env.reset(step.done)
        step_s, restart_s = step_s + stepped - began, restart_s + clock() - stepped
        wall_s += time.perf_counter() - began_s
    blocks.step_s.append(step_s / ENV_STEPS)
    blocks.restart_s.append(restart_s / ENV_STEPS)
    blocks.wall_s.append(wall_s / ENV_STEPS)
    blocks.pressing.append(float((env.state.contact_force_n != 0).any(axis=2).mean()))
    blocks.advance_s.append(timed.seconds / ENV_STEPS)
    began = clock()
    coast(timed.specs[0].timing.substeps)
    blocks.raw_s.append(clock() - began)


def _summary(blocks: _Blocks) -> Timing:
    whole = np.add(blocks.step_s, blocks.restart_s)
    chunks = np.array_split(np.arange(len(whole)), max(len(whole) // CHUNK, 1))
    ratios = [whole[c].sum() / np.take(blocks.raw_s, c).sum() - 1.0 for c in chunks]
    low, middle, high = np.percentile(ratios, [25, 50, 75]).tolist()
    return Timing(
        step_s=float(np.mean(blocks.step_s)),
        restart_s=float(np.mean(blocks.restart_s)),
        wall_s=float(np.mean(blocks.wall_s)),
        advance_s=float(np.mean(blocks.advance_s)),
        raw_s=float(np.mean(blocks.raw_s)),
        overhead=(low, middle, high),
        pressing=float(np.mean(blocks.pressing)),
        blocks=len(whole),
    )
