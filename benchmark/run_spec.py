"""A run's identity: everything that decides its result, frozen, and the worlds it asks for."""

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from backends import trx
from backends.effect import Effect, with_effects
from backends.randomize import randomize
from backends.shard import simulate
from backends.spec import Spec
from backends.sticks import STICKS
from benchmark import registry
from benchmark.effects import effect_name, parse_effects, parse_spread
from benchmark.errors import UsageError, unknown
from tasks.batch import BatchEnv
from tasks.task import RADIUS_M

HANDS = {"trx": trx}
DEFAULT_STEPS = 1_000_000
TRAIN_WORLDS = 128
SMOKE_WORLDS, SMOKE_STEPS = 8, 1024
RADIUS_RANGE_M = (0.001, 0.05)
SPEED_RANGE = (0.05, 5.0)
MAX_STEPS = 10**10
LATER = {"start_spread": 1.0}
"""Fields that older runs do not have, and what they were run with."""


@dataclass(frozen=True, kw_only=True)
class RunSpec:
    """What is run; equal specs give equal rows."""

    backend: str
    task: str
    observation: str = "contact-centers"
    algo: str = "sb3-ppo"
    hand: str = "trx"
    stick: str = "reference"
    effects: str = "built"
    radius_m: float = RADIUS_M
    """Size of the figure [m]."""
    speed: float = 1.0
    """Pace of the figure over the training pace."""
    steps: int = DEFAULT_STEPS
    """Training budget in environment steps; 0 for baselines that do not train."""
    seed: int = 0
    randomize: bool = True
    """Whether training draws its worlds around the nominal one."""
    spread: str = "paper"
    """How far it draws them: effects with standard deviations or half widths."""
    start_spread: float = 1.0
    """Width of the initial states that training draws over that of Algorithm 1; 0: a single one."""
    worlds: int = TRAIN_WORLDS
    """Worlds trained on at once."""
    smoke: bool = False
    """A run that walks the whole path and is never ranked."""

    def __post_init__(self) -> None:
        for kind in ("backend", "task", "observation"):
            registry.check(kind, getattr(self, kind))
        registry.check("algorithm", self.algo)
        if self.hand not in HANDS:
            raise unknown("hand", self.hand, HANDS)
        if self.stick not in STICKS:
            raise unknown("stick", self.stick, STICKS)
        within("--radius", self.radius_m * 100, RADIUS_RANGE_M[0] * 100, RADIUS_RANGE_M[1] * 100)
        within("--speed", self.speed, *SPEED_RANGE)
        within("--start-spread", self.start_spread, 0, 1)
        within("--steps", self.steps, 0, MAX_STEPS)
        within("--seed", self.seed, 0, 2**32 - 1)
        parse_effects(self.effects, HANDS[self.hand].HAND)
        parse_spread(self.spread, HANDS[self.hand].HAND)

    @property
    def digest(self) -> str:
        """What `run_digest` says of this run."""
        return run_digest(dataclasses.asdict(self), self.world().digest)

    @property
    def name(self) -> str:
        """A readable folder name that no other run has."""
        smoke = "-smoke" if self.smoke else ""
        parts = (self.backend, self.task, self.algo, self.observation)
        return f"{'-'.join(parts)}-s{self.seed}{smoke}-{self.digest[:8]}"

    def world(self) -> Spec:
        """The nominal world: hand and stick with the effects applied in order."""
        hand = HANDS[self.hand]
        spec: Spec = hand.spec(STICKS[self.stick])
        return with_effects(spec, parse_effects(self.effects, hand.HAND))


def run_digest(fields: dict, world_digest: str) -> str:
    """First 12 hex digits of the SHA-256 of a run's fields and of its nominal world.

    Fields that came later count where they are not their default: they rename no older run.
    """
    counted = {name: value for name, value in fields.items() if LATER.get(name) != value}
    text = json.dumps([counted, world_digest], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def make_env(run: RunSpec, worlds: list[Spec], seed: int, workers: int) -> BatchEnv:
    """The batched environment of a run on the given worlds; raises UsageError where they refuse."""
    engine = registry.load("backend", run.backend)
    task = registry.load("task", run.task)(radius_m=run.radius_m, speed=run.speed)
    observation = registry.load("observation", run.observation)(worlds[0].hand)
    hand = worlds[0].hand
    effects = parse_effects(run.effects, hand) + parse_spread(run.spread, hand)
    refuse(effects, engine.support, run.backend)
    simulator = simulate(engine, worlds, workers)
    return BatchEnv(simulator, task, observation, seed, run.start_spread)


def refuse(effects: Iterable[Effect], support: Mapping[str, str], backend: str) -> None:
    """Raise UsageError for an effect that the engine cannot have."""
    for effect in effects:
        for field in effect.spec_fields():
            if effect.magnitude != 0.0 and support[field].startswith("refused"):
                raise UsageError(f"{effect_name(effect)} is {support[field]} ({backend})")


def training_worlds(run: RunSpec, segment: int) -> list[Spec]:
    """The worlds of one training segment: drawn anew for each, or all nominal."""
    nominal = run.world()
    if not run.randomize:
        return [nominal] * run.worlds
    rng = np.random.default_rng([run.seed, segment])
    spread = parse_spread(run.spread, nominal.hand)
    return [randomize(nominal, spread, rng) for _ in range(run.worlds)]


def within(flag: str, value: float, low: float, high: float) -> None:
    """Raise UsageError unless a number is finite and in its range."""
    if not (math.isfinite(value) and low <= value <= high):
        raise UsageError(f"{flag} is {value:g}; allowed: {low:g} to {high:g}")
