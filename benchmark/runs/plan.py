"""What a run would be and how long it would take, from a short measurement."""

import dataclasses
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmark.provenance import usable_cores
from benchmark.runs.run_folder import RUNS
from benchmark.settings.run_spec import RunSpec
from leaderboard.identity import EPISODES, SMOKE_EPISODES

_PROBE_STEPS = 15


def plan(spec: RunSpec, out: Path | None, workers: int | None) -> dict:
    """The settings of a run and an estimate of its duration from a short measurement."""
    workers = workers or usable_cores()
    worlds = [spec.world()] * min(spec.worlds, 16 * workers)
    env = spec.make_env(worlds, seed=0, workers=workers)
    try:
        env.reset()
        still = np.zeros((env.worlds, env.action_width))
        rate = env.worlds / typical_s(lambda: env.step(still))
    finally:
        env.close()
    evaluation = (SMOKE_EPISODES if spec.smoke else EPISODES) * env.horizon
    return {
        "would_run": dataclasses.asdict(spec),
        "dir": str(out or RUNS / spec.name),
        "digest": spec.digest,
        "measured_env_steps_per_s": round(rate, 1),
        "simulation_minutes": round((spec.steps + evaluation) / rate / 60, 1),
    }


def typical_s(call: Callable[[], object]) -> float:
    """The median time of a call [s]; in a new installation some calls compile code first."""
    took = []
    for _ in range(_PROBE_STEPS):
        began = time.monotonic()
        call()
        took.append(time.monotonic() - began)
    return statistics.median(took)
