"""Evaluation: fixed episodes, the same for every policy and world, and their scores."""

import dataclasses
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from backends.shard import WorkerError
from backends.state import Array
from baselines.saved import POLICY_FILE, PolicyError, SavedPolicy
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.runs import run_folder
from benchmark.settings.quantities import within
from benchmark.settings.run_spec import RunSpec, read_settings
from leaderboard.identity import EPISODES, SMOKE_EPISODES
from tasks.batch import BatchEnv, SimulationDivergedError, Step
from tasks.initial_states import sample_initial_states

EVALUATION_SEED = 20260101
"""Seed of initial states and headings in the evaluation; training seeds are hashed."""


@dataclass(frozen=True, kw_only=True)
class Episodes:
    """Scores of E episodes."""

    p_err_cm: Array
    """Mean error of the lower end while the stick was held [cm], shape (E,)."""
    q_err_deg: Array
    """Mean error of the axis while the stick was held [deg], shape (E,)."""
    held: Array
    """Fraction of the episode before the stick fell, shape (E,)."""
    tracked: Array
    """Fraction of all reference steps held within 1.0 cm and 5 degrees, shape (E,)."""

    def scores(self) -> dict[str, float]:
        """Means over the episodes, and their count."""
        means = {name: float(np.mean(values)) for name, values in asdict(self).items()}
        return {**means, "episodes": len(self.held)}


def evaluate(
    env: BatchEnv,
    act: Callable[[Array], Array],
    on_step: Callable[[BatchEnv, Step], None] = lambda env, step: None,
    seed: int = EVALUATION_SEED,
) -> Episodes:
    """Run one episode per world of `env` from the fixed initial states, with the actions of `act`.

    Another `seed` gives other initial states and headings. A world whose stick has fallen is still
    stepped to keep the batch together, but no longer counts.
    """
    rng = np.random.default_rng(seed)
    start = sample_initial_states(env.simulator.specs, rng)
    env.seed(seed)
    observation = env.reset(start=start)
    held = np.ones(env.worlds, dtype=bool)
    steps_held, tracked, end, axis = (np.zeros(env.worlds) for _ in range(4))
    for _ in range(env.horizon):
        step = env.step(act(observation))
        observation = step.observation
        held &= ~step.terminated
        steps_held += held
        tracked += held & step.tracked
        end += np.where(held, step.end_error_m, 0)
        axis += np.where(held, step.axis_error_rad, 0)
        on_step(env, step)
    some = np.maximum(steps_held, 1)
    return Episodes(
        p_err_cm=100 * end / some,
        q_err_deg=np.degrees(axis / some),
        held=steps_held / env.horizon,
        tracked=tracked / env.horizon,
    )


def evaluate_run(
    spec: RunSpec,
    policy: Path,
    workers: int,
    episodes: int | None = None,
    watch: Callable[[BatchEnv, Step], None] = lambda env, step: None,
    seed: int = EVALUATION_SEED,
) -> Episodes:
    """Evaluate the policy in a folder, or the scripted baseline, in the world of `spec`.

    `episodes` limits the number of fixed episodes, `seed` selects another list of them, and `watch`
    is called after every step. Raises UsageError if policy, observation, stick and hand do not fit.
    """
    count = episodes or (SMOKE_EPISODES if spec.smoke else EPISODES)
    env = spec.make_env([spec.world()] * count, seed=0, workers=workers)
    try:
        act = _actor(spec, policy, env)
        with Bar(f"evaluate {spec.backend} {spec.task}", env.horizon) as bar:
            done = iter(range(1, env.horizon + 1))

            def on_step(env: BatchEnv, step: Step) -> None:
                bar.update(next(done))
                watch(env, step)

            return evaluate(env, act, on_step, seed)
    except PolicyError as error:
        raise UsageError(str(error)) from error
    except ValueError as error:
        raise UsageError(f"{spec.stick} stick in this hand: {error}") from error
    finally:
        env.close()


def deploy(spec: RunSpec, policy: Path, workers: int, **options: Any) -> Episodes:
    """`evaluate_run` of a finished policy; raises CommandError if the simulation stops."""
    try:
        return evaluate_run(spec, policy, workers, **options)
    except (SimulationDivergedError, WorkerError) as error:
        raise CommandError(f"the simulation on {spec.backend} stopped: {error}") from error


def _actor(spec: RunSpec, policy: Path, env: BatchEnv) -> Callable[[Array], Array]:
    if (policy / POLICY_FILE).exists():
        return SavedPolicy(policy, env.observation)
    baseline = registry.load("algo", spec.algo)
    if baseline.trains:
        raise PolicyError(f"{policy} has no {POLICY_FILE}: its training has not finished")
    return baseline(env.action_width, spec.seed)


def write_episodes(episodes: Episodes, path: Path) -> None:
    """One row per episode, as parquet."""
    frame = pd.DataFrame({"episode": range(len(episodes.held)), **vars(episodes)})
    temporary = path.with_name(f".{path.name}.tmp")
    frame.to_parquet(temporary, index=False)
    temporary.replace(path)


def evaluate_policy(
    folder: Path,
    given: Mapping[str, Any],
    episodes: int | None,
    out: Path | None,
    workers: int | None,
) -> dict:
    """Evaluate a finished run's policy under changed settings; returns the row."""
    if episodes is not None:
        within("--episodes", episodes, 1, EPISODES)
    source = run_folder.finished_run(folder)
    spec = dataclasses.replace(run_folder.run_spec(source), **read_settings(given))
    found = deploy(spec, folder, workers or usable_cores(), episodes=episodes)
    row = {
        "status": "done",
        **{k: getattr(spec, k) for k in ("backend", "task", "algo", "observation", "effects")},
        **found.scores(),
        "stick": spec.stick,
        "radius_m": spec.radius_m,
        "speed": spec.speed,
        "policy": str(folder),
        "trained": source["spec"],
        "spec_digest": spec.world().digest,
        "provenance": provenance(),
    }
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_episodes(found, out / run_folder.EPISODES_FILE)
        run_folder.write_atomically(out / "eval.json", json.dumps(row, indent=2) + "\n")
    return row
