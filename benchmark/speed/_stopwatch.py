"""Time a step of an environment and a step of its bare engine, in alternating blocks.

Both step the same worlds with the stick in the same grasp. A block depends on how fast the machine
was at that moment, but the ratio within a block does not.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from tasks.batch import BatchEnv

SETTLE_STEPS = 20
"""Environment steps from the start of an episode until the grasp is at rest: 0.4 s."""
ENV_STEPS = 4
"""Environment steps in a block. They also restore the grasp, which slips within 0.1 s under
constant torques. The single period with constant torques in a block moves joints by 0.1 mrad."""
EPISODE_BLOCKS = 45
"""Blocks until new episodes begin, each of six periods: 290 of 300 steps."""
MIN_BLOCKS = 6
RESTARTS = 3
"""Number of restarts that are timed after each episode."""
Clock = Callable[[], float]
"""A clock in seconds: CPU time or wall time."""


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Times for one policy period of all worlds [s], medians over the blocks."""

    step_s: float
    """An environment step: drives, engine, touch, observation, reward."""
    wall_s: float
    """The same in wall time, whichever clock the others use."""
    advance_s: float
    """The part of drives and engine, with reading joints, stick and contacts."""
    raw_s: float
    """The bare engine under constant torques."""
    restart_s: float
    """Restarts, per step, if each world begins an episode every 300 steps."""
    overhead: tuple[float, float, float]
    """Quartiles over the blocks of (step + restart) / raw - 1, the median in the middle."""
    pressing: float
    """Share of fingertips that pressed the stick, checked in every block."""
    blocks: int


@dataclass(kw_only=True)
class _Blocks:
    """The measurements, block by block [s]."""

    step_s: list[float] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    advance_s: list[float] = field(default_factory=list)
    raw_s: list[float] = field(default_factory=list)
    restart_s: list[float] = field(default_factory=list)
    pressing: list[float] = field(default_factory=list)


def measure(
    env: BatchEnv, coast: Callable[[int], None], seconds: float, clock: Clock = time.perf_counter
) -> Timing:
    """Time an environment and, with `coast`, its bare engine, for about `seconds`."""
    blocks, still = _Blocks(), np.zeros((env.worlds, env.action_width))
    began = time.perf_counter()
    while not blocks.raw_s or time.perf_counter() - began < seconds:
        env.reset()
        for _ in range(SETTLE_STEPS):
            env.step(still)
        for _ in range(EPISODE_BLOCKS):
            _block(env, coast, still, blocks, clock)
            if len(blocks.raw_s) >= MIN_BLOCKS and time.perf_counter() - began > seconds:
                break
        _restarts(env, blocks, clock)
    return _summary(blocks)


def _block(
    env: BatchEnv,
    coast: Callable[[int], None],
    still: np.ndarray,
    blocks: _Blocks,
    clock: Clock,
) -> None:
    """Time single periods, because longer ones are interrupted more often on a shared machine."""
    began = time.perf_counter()
    steps = [_seconds(lambda: env.step(still), clock) for _ in range(ENV_STEPS)]
    blocks.wall_s.append((time.perf_counter() - began) / ENV_STEPS)
    blocks.step_s.append(float(np.median(steps)))
    blocks.pressing.append(float((env.state.contact_force_n != 0).any(axis=2).mean()))
    blocks.advance_s.append(_seconds(lambda: env.simulator.advance(env.target_rad), clock))
    substeps = env.simulator.specs[0].timing.substeps
    blocks.raw_s.append(_seconds(lambda: coast(substeps), clock))


def _seconds(action: Callable[[], object], clock: Clock) -> float:
    began = clock()
    action()
    return clock() - began


def _restarts(env: BatchEnv, blocks: _Blocks, clock: Clock) -> None:
    """Begin new episodes in as many worlds as end at a time, at least one."""
    at_once = max(1, round(env.worlds / env.horizon))
    for k in range(RESTARTS):
        mask = np.roll(np.arange(env.worlds) < at_once, k * at_once)
        share = env.worlds / env.horizon / at_once
        blocks.restart_s.append(share * _seconds(partial(env.reset, mask), clock))


def _summary(blocks: _Blocks) -> Timing:
    restart_s = float(np.median(blocks.restart_s))
    ratios = (np.array(blocks.step_s) + restart_s) / np.array(blocks.raw_s) - 1
    low, middle, high = np.percentile(ratios, [25, 50, 75]).tolist()
    return Timing(
        step_s=float(np.median(blocks.step_s)),
        wall_s=float(np.median(blocks.wall_s)),
        advance_s=float(np.median(blocks.advance_s)),
        raw_s=float(np.median(blocks.raw_s)),
        restart_s=restart_s,
        overhead=(low, middle, high),
        pressing=float(np.mean(blocks.pressing)),
        blocks=len(blocks.raw_s),
    )
