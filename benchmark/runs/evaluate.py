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
from backends.spec import Spec
from backends.state import Array
from baselines.saved import CONTRACT_FILE, POLICY_FILE, PolicyError, SavedPolicy, read_contract
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.runs import run_folder
from benchmark.settings.run_spec import REFERENCE, RunSpec, read_settings
from leaderboard.identity import EPISODES, SMOKE_EPISODES
from tasks.batch import BatchEnv, NotFiniteActionError, SimulationDivergedError, Step
from tasks.initial_states import sample_initial_states
from tasks.observation import Observation

FOREIGN = "foreign"
"""The algorithm of a policy that another program made."""
EVAL_FILE = "eval.json"
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
    observation: Observation | None = None,
) -> Episodes:
    """Evaluate the policy in a folder, or the scripted baseline, in the world of `spec`.

    `episodes` limits the number of fixed episodes, `seed` selects another list of them, and `watch`
    is called after every step. `observation`: that of its contract, of a policy of others. Raises
    UsageError if policy, observation, stick and hand do not fit, CommandError where its actions are
    not finite.
    """
    count = episodes or (SMOKE_EPISODES if spec.smoke else EPISODES)
    worlds = [world_of(spec, observation)] * count
    env = spec.make_env(worlds, seed=0, workers=workers, observation=observation)
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
    except NotFiniteActionError as error:
        raise CommandError(f"{policy}: {error}") from error
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


def is_foreign(folder: Path) -> bool:
    """Whether a folder holds a policy of another program: an ONNX file and its contract."""
    return (folder / CONTRACT_FILE).exists() and not (folder / run_folder.RUN_FILE).exists()


def world_of(spec: RunSpec, observation: Observation | None) -> Spec:
    """The world of a run, in which the policy acts as often as its contract says."""
    world = spec.world()
    period_s = observation.law.period_s if observation else world.timing.policy_s
    return dataclasses.replace(world, timing=dataclasses.replace(world.timing, policy_s=period_s))


def _foreign(folder: Path, given: Mapping[str, Any]) -> tuple[RunSpec, Observation]:
    """The settings and the observation for a policy of another program; raises UsageError."""
    from tasks.contract import Contracted, ContractError

    if "task" not in given:
        raise UsageError(f"{folder} has no {run_folder.RUN_FILE}; say what to do: --task circle")
    spec = RunSpec(**{"backend": REFERENCE, **given})
    world = spec.world()
    names = registry.names("observation")
    known = [registry.load("observation", name)(world.hand) for name in names]
    try:
        found = Contracted(world.hand, read_contract(folder), known)
    except PolicyError as error:
        raise UsageError(str(error)) from error
    except ContractError as error:
        raise UsageError(f"{folder / CONTRACT_FILE}: {error}") from error
    ticks = found.law.period_s / world.timing.drive_s
    if abs(ticks - round(ticks)) > 1e-6:
        raise UsageError(
            f"{folder / CONTRACT_FILE}: action.period_s is {found.law.period_s:g}; allowed: whole "
            f"multiples of {world.timing.drive_s:g}"
        )
    return spec, found


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
    known, observation = ("algo", "observation"), None
    if is_foreign(folder):
        spec, observation = _foreign(folder, read_settings(given))
        made = {"algo": FOREIGN, "observation": CONTRACT_FILE, "trained": None}
    else:
        source = run_folder.finished_run(folder)
        spec = dataclasses.replace(run_folder.run_spec(source), **read_settings(given))
        made = {**{k: getattr(spec, k) for k in known}, "trained": source["spec"]}
    count = workers or usable_cores()
    found = deploy(spec, folder, count, episodes=episodes, observation=observation)
    row = {
        "status": "done",
        **{k: getattr(spec, k) for k in ("backend", "task")},
        **{k: made[k] for k in known},
        "effects": spec.effects,
        **found.scores(),
        "stick": spec.stick,
        "radius_m": spec.radius_m,
        "speed": spec.speed,
        "policy": str(folder),
        "trained": made["trained"],
        "spec_digest": world_of(spec, observation).digest,
        "provenance": provenance(),
    }
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_episodes(found, out / run_folder.EPISODES_FILE)
        run_folder.write_atomically(out / EVAL_FILE, json.dumps(row, indent=2) + "\n")
    files = () if out is None else (out / run_folder.EPISODES_FILE, out / EVAL_FILE)
    return row | {"written": [str(file) for file in files]}
