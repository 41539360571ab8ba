"""The identity of a run: all settings that decide its result, frozen.

Each setting is declared once, as a field here. Command line, grid files and checks use it.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from backends.effect import Effect, with_effects
from backends.spec import Spec
from backends.sticks import STICKS
from benchmark.errors import UsageError, unknown
from benchmark.parts import registry
from benchmark.settings.effects import parse_effects, parse_spread, refuse
from benchmark.settings.kinds import (
    Choice,
    Name,
    Number,
    Setting,
    Switch,
    Text,
    setting,
    settings_of,
)
from leaderboard.identity import BUDGET, ENDS, learner_name, run_digest
from tasks.task import RADIUS_M

if TYPE_CHECKING:
    from tasks.batch import BatchEnv
    from tasks.observation import Observation

REFERENCE = "mujoco"
"""The engine that the others are compared with; it simulates where none has to be named."""
SMOKE_WORLDS, SMOKE_STEPS = 8, 1024
MOST_WORLDS = 100_000
"""Most worlds trained on at once; more fill the memory."""
WORLD, FIGURE, PERCEPT, TRAINING = "world", "figure", "percept", "training"
"""What a setting decides: what simulates, what is asked, what a policy gets, how it learns."""


@dataclass(frozen=True, kw_only=True)
class RunSpec:
    """All settings of a run; equal specs give equal rows.

    Raises UsageError for invalid settings.
    """

    backend: str = setting(
        "Physics engine that simulates.", Name("backend"), alias="engine", of=WORLD
    )
    task: str = setting("Figure that the stick's lower end draws.", Name("task"), of=FIGURE)
    observation: str = setting(
        "Observation that the policy gets.", Name("observation"), "contact-centers", of=PERCEPT
    )
    algo: str = setting(
        "Learning algorithm, or scripted baseline.", Name("algo"), "sb3-ppo", of=TRAINING
    )
    hand: str = "trx"
    """The hand; `bench list hand` names them."""
    stick: str = setting("Stick to hold.", Choice("stick", tuple(STICKS)), "reference", of=WORLD)
    effects: str = setting(
        "What the world adds to the ideal hand: 'built', 'none', or effects between commas, such "
        "as backlash=1.2deg@J3.",
        Text("SET"),
        "built",
        of=WORLD,
    )
    radius_m: float = setting(
        "Size of the figure.", Number(0.1, 5, "cm"), RADIUS_M, "radius", of=FIGURE
    )
    speed: float = setting(
        "Pace of the figure, times the training pace.", Number(0.05, 5), 1.0, "pace", of=FIGURE
    )
    steps: int = setting(
        "Training budget in environment steps.", Number(0, 1e10, whole=True), 1_000_000, of=TRAINING
    )
    until: str = setting(
        "When training ends, at the latest with its budget.",
        Choice("end of training", ENDS),
        BUDGET,
        of=TRAINING,
    )
    seed: int = setting(
        "Decides every random draw of the training.",
        Number(0, 2**32 - 1, whole=True),
        0,
        of=TRAINING,
    )
    randomize: bool = setting(
        "Train on worlds drawn around the nominal one.", Switch(), True, of=TRAINING
    )
    spread: str = setting(
        "How far they are drawn: 'paper', or effects with their spreads.",
        Text("SET"),
        "paper",
        of=TRAINING,
    )
    start_spread: float = setting(
        "Width of the drawn initial states over the paper's; 0: a single one.",
        Number(0, 1),
        1.0,
        of=PERCEPT,
    )
    worlds: int = 128
    """Worlds trained on at once."""
    smoke: bool = setting(
        "Walk the whole path in under a minute; never ranked.", Switch(), False, of=TRAINING
    )
    overrides: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Hyperparameters of the learner that differ from its defaults, by name."""
    start_sha256: str | None = None
    """SHA-256 of the policy that training starts from; None: a new policy."""

    def __post_init__(self) -> None:
        for one in SETTINGS.values():
            object.__setattr__(self, one.field, one.read(getattr(self, one.field)))
        Number(1, MOST_WORLDS, whole=True).read(self.worlds, "worlds")
        _ = self.added, self.drawn

    @cached_property
    def added(self) -> tuple[Effect, ...]:
        """What the world adds to the ideal hand: `effects`, read."""
        return parse_effects(self.effects, ideal(self.hand, self.stick).hand)

    @cached_property
    def drawn(self) -> tuple[Effect, ...]:
        """What training draws: `spread`, read."""
        return parse_spread(self.spread, ideal(self.hand, self.stick).hand)

    @property
    def digest(self) -> str:
        """The `run_digest` of this run."""
        return run_digest(dataclasses.asdict(self), self.world().digest)

    @property
    def name(self) -> str:
        """A readable folder name, unique to this run."""
        smoke = "-smoke" if self.smoke else ""
        parts = (self.backend, self.task, self.algo, self.observation)
        return f"{'-'.join(parts)}-s{self.seed}{smoke}-{self.digest[:8]}"

    @property
    def learner(self) -> str:
        """The algorithm with its changed hyperparameters, such as 'sb3-ppo lr=0.0003'."""
        return learner_name(self.algo, self.overrides, self.start_sha256, self.until)

    def world(self) -> Spec:
        """The nominal world: hand and stick with the effects applied in order."""
        return with_effects(ideal(self.hand, self.stick), self.added)

    def make_env(
        self,
        worlds: list[Spec],
        seed: int,
        workers: int,
        episode_steps: int | None = None,
        observation: "Observation | None" = None,
    ) -> "BatchEnv":
        """The batched environment of the run in these worlds; UsageError if they are refused.

        `observation`: what is seen instead of the run's own.
        """
        from backends.shard import simulate
        from tasks.batch import BatchEnv

        engine = registry.load("backend", self.backend)
        task = registry.load("task", self.task)(radius_m=self.radius_m, speed=self.speed)
        hand = worlds[0].hand
        seen = observation or registry.load("observation", self.observation)(hand)
        refuse((*self.added, *self.drawn), engine.support, self.backend)
        simulator = simulate(engine, worlds, workers)
        return BatchEnv(simulator, task, seen, seed, self.start_spread, episode_steps)


def ideal(hand: str, stick: str) -> Spec:
    """A hand with a stick, by name, without effects; raises UsageError for an unknown one."""
    if stick not in STICKS:
        raise unknown("stick", stick, STICKS)
    made: Spec = registry.load("hand", hand)(STICKS[stick])
    return made


SETTINGS: dict[str, Setting] = settings_of(RunSpec)
"""The settings of a run, by name as typed."""


def settings_for(*decide: str) -> tuple[str, ...]:
    """Names of the settings that decide these."""
    return tuple(name for name, one in SETTINGS.items() if one.of in decide)


DEPLOYED = settings_for(WORLD, FIGURE)
"""Settings that may differ between training and evaluation of a policy."""

_BY_NAME = {name: one for one in SETTINGS.values() for name in one.names}


def setting_named(name: str) -> Setting:
    """A setting by any of its names, such as radius and radius_m; raises UsageError."""
    found = _BY_NAME.get(name.replace("-", "_"))
    if found is None:
        raise unknown("setting", name, SETTINGS)
    return found


def read_settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a RunSpec from settings by name (None: not given); raises UsageError."""
    fields: dict[str, Any] = {}
    for name, value in given.items():
        one = setting_named(name)
        if value is not None and one.field in fields:
            raise UsageError(f"{one.name} is given twice: as {' and as '.join(one.names)}")
        if value is not None:
            fields[one.field] = one.read(value)
    return fields
