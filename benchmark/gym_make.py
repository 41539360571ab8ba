"""Make the Gymnasium environments that `benchmark.gym` registers."""

from functools import partial
from typing import Any

from benchmark.run_spec import RunSpec
from benchmark.worlds import make_env
from tasks.batch import BatchEnv
from tasks.gym_env import StickEnv, StickVectorEnv


def single(task: str, backend: str = "mujoco", **settings: Any) -> StickEnv:
    """One world; settings are fields of `RunSpec`: observation, stick, effects, radius_m, speed."""
    return StickEnv(partial(_make, RunSpec(backend=backend, task=task, **settings), 1))


def vector(
    task: str, num_envs: int = 1, backend: str = "mujoco", workers: int = 1, **settings: Any
) -> StickVectorEnv:
    """N worlds on up to `workers` cores; settings as in `single`."""
    run = RunSpec(backend=backend, task=task, **settings)
    return StickVectorEnv(partial(_make, run, workers), num_envs)


def _make(run: RunSpec, workers: int, worlds: int, seed: int) -> BatchEnv:
    return make_env(run, [run.world()] * worlds, seed, workers)
