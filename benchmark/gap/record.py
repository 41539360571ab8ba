"""`bench record`: run the protocols on an engine with effects, and write a log."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backends.engine import Simulator
from backends.shard import WorkerError, simulate
from backends.spec import Spec
from baselines.saved import POLICY_FILE, PolicyError, SavedPolicy
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.runs import run_folder
from benchmark.settings.effects import parse_effects, refuse
from benchmark.settings.run_spec import RunSpec, read_settings
from diagnosis.logs.log import Log, LogError, check_target, write_log
from diagnosis.recording import record as recording
from diagnosis.recording.excitation import OPEN_LOOP
from diagnosis.recording.record import ALWAYS, CHANNELS, Plan, Policy
from tasks.batch import NotFiniteActionError, SimulationDivergedError

MOST_EPISODES = 1000
"""Most episodes in a log, which is held in memory as a whole."""
_STEPS = 100
"""Steps of the progress bar."""


@dataclass(frozen=True, kw_only=True)
class World:
    """What is recorded, and where."""

    run: RunSpec
    """Engine, hand, stick and effects, and the policy's task if there is a policy."""
    policy: Path | None
    """Run folder of the policy."""
    known_effects: str
    """Effects that the log may name."""
    workers: int | None


def world(
    given: Mapping[str, Any], known_effects: str, policy: Path | None, workers: int | None
) -> World:
    """The world of these settings; raises UsageError."""
    settings: dict = {"task": "line", "randomize": False}
    if policy is not None:
        source = run_folder.finished_run(policy)
        kept = ("task", "observation", "algo", "hand", "radius_m", "speed", "seed")
        settings |= {key: source["spec"][key] for key in kept}
    run = RunSpec(**settings, **read_settings(given))
    parse_effects(known_effects, run.world().hand)
    return World(run=run, policy=policy, known_effects=known_effects, workers=workers)


def plan(
    world: World,
    protocol: str,
    channels: str,
    rate_hz: float,
    variants: int,
    repeats: int,
    seed: int,
) -> Plan:
    """The plan of these options; 'all' means everything that is possible. Raises UsageError."""
    everything = (*OPEN_LOOP, *(["policy"] if world.policy else []))
    protocols = everything if protocol == "all" else _words(protocol)
    if world.policy is not None and "policy" not in protocols:
        raise UsageError(
            "--policy is given without protocol 'policy'; add it, or leave --policy out"
        )
    episodes = len(protocols) * variants * repeats
    if episodes > MOST_EPISODES:
        raise UsageError(
            f"{len(protocols)} protocols, {variants} variants and {repeats} repeats are {episodes} "
            f"episodes; allowed: up to {MOST_EPISODES} in a log; record several"
        )
    named = CHANNELS if channels == "all" else tuple(dict.fromkeys((*ALWAYS, *_words(channels))))
    return Plan(
        protocols=protocols,
        channels=named,
        rate_hz=rate_hz,
        variants=variants,
        repeats=repeats,
        seed=seed,
    )


def record(world: World, plan: Plan, out: Path, form: str, force: bool = False) -> dict:
    """Record a log into the folder `out`; `force` replaces an earlier one.

    Raises UsageError for a plan that cannot be recorded, CommandError if the simulation stops.
    """
    try:
        check_target(out, form, force)
        log = _record(world, plan)
        write_log(log, out, form, _provenance(world, plan), force)
    except (LogError, PolicyError) as error:
        raise UsageError(str(error)) from error
    except (SimulationDivergedError, WorkerError) as error:
        raise CommandError(f"the simulation on {world.run.backend} stopped: {error}") from error
    return {
        "status": "done",
        "dir": str(out),
        "backend": world.run.backend,
        "effects": world.run.effects,
        "protocols": list(plan.protocols),
        "channels": list(plan.channels),
        "rate_hz": plan.rate_hz,
        "seed": plan.seed,
        "episodes": len(log.episodes),
        "samples": len(log.samples),
        "spec_digest": world.run.world().digest,
    }


def _record(world: World, plan: Plan) -> Log:
    engine = registry.load("backend", world.run.backend)
    spec = world.run.world()
    refuse(world.run.added, engine.support, world.run.backend)
    workers = world.workers or usable_cores()

    def start(specs: Sequence[Spec]) -> Simulator:
        return simulate(engine, specs, workers)

    with Bar(f"record {world.run.backend}", _STEPS) as bar:
        try:
            return recording.record(
                start,
                spec,
                plan,
                source=f"bench record, {world.run.backend}",
                policy=_policy(world, spec) if world.policy else None,
                known_effects=world.known_effects,
                progress=lambda share: bar.update(round(_STEPS * share)),
            )
        except LogError:
            raise
        except NotFiniteActionError as error:
            raise CommandError(f"{world.policy}: {error}") from error
        except ValueError as error:
            raise UsageError(f"{world.run.stick} stick in this hand: {error}") from error


def _policy(world: World, spec: Spec) -> Policy:
    run, folder = world.run, world.policy
    assert folder is not None
    task = registry.load("task", run.task)(radius_m=run.radius_m, speed=run.speed)
    observation = registry.load("observation", run.observation)(spec.hand)
    if (folder / POLICY_FILE).exists():
        act = SavedPolicy(folder, observation)
    else:
        act = registry.load("algo", run.algo)(len(spec.hand.driven), run.seed)
    return Policy(task=task, observation=observation, act=act)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _provenance(world: World, plan: Plan) -> dict:
    """The provenance of the log. It names the effects, so a diagnosis does not read it."""
    run = world.run
    return {
        **provenance(),
        "backend": run.backend,
        "effects": run.effects,
        "policy": str(world.policy) if world.policy else None,
        "seed": plan.seed,
        "spec_digest": run.world().digest,
    }
