"""The worlds of a run: its batched environment, and the worlds drawn for training."""

from collections.abc import Iterable, Mapping

import numpy as np

from backends.effect import Effect
from backends.randomize import randomize
from backends.shard import simulate
from backends.spec import Spec
from benchmark.errors import UsageError
from benchmark.parts import registry
from benchmark.settings.effects import effect_name, parse_effects, parse_spread
from benchmark.settings.run_spec import RunSpec
from tasks.batch import BatchEnv


def make_env(
    run: RunSpec, worlds: list[Spec], seed: int, workers: int, episode_steps: int | None = None
) -> BatchEnv:
    """The batched environment of a run on the given worlds; UsageError if they are refused."""
    engine = registry.load("backend", run.backend)
    task = registry.load("task", run.task)(radius_m=run.radius_m, speed=run.speed)
    observation = registry.load("observation", run.observation)(worlds[0].hand)
    hand = worlds[0].hand
    effects = parse_effects(run.effects, hand) + parse_spread(run.spread, hand)
    refuse(effects, engine.support, run.backend)
    simulator = simulate(engine, worlds, workers)
    return BatchEnv(simulator, task, observation, seed, run.start_spread, episode_steps)


def refuse(effects: Iterable[Effect], support: Mapping[str, str], backend: str) -> None:
    """Raise UsageError for an effect that the engine does not support."""
    for effect in effects:
        for field in effect.spec_fields():
            if effect.magnitude != 0.0 and support[field].startswith("refused"):
                raise UsageError(f"{effect_name(effect)} is {support[field]} ({backend})")


def training_worlds(run: RunSpec, segment: int) -> list[Spec]:
    """The worlds of one training segment: newly drawn, or all nominal."""
    nominal = run.world()
    if not run.randomize:
        return [nominal] * run.worlds
    rng = np.random.default_rng([run.seed, segment])
    spread = parse_spread(run.spread, nominal.hand)
    return [randomize(nominal, spread, rng) for _ in range(run.worlds)]
