"""`bench diagnose`: from a log to diagnosis.json, report.html and a summary."""

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

import joblib
from joblib.externals.loky import get_reusable_executor
from rich.console import RenderableType

from backends.effect import UNITS, Effect, with_effects
from backends.engine import Engine
from backends.shard import WorkerError, simulate
from backends.spec import Spec
from backends.sticks import STICKS
from benchmark import registry
from benchmark._diagnosis_texts import effects_text, summary
from benchmark.console import Bar
from benchmark.effects import parse_effects
from benchmark.errors import CommandError, UsageError, unknown
from benchmark.provenance import provenance, usable_cores
from benchmark.run_folder import write_atomically
from benchmark.run_spec import HANDS
from diagnosis.attribution.evidence import USED, Evidence
from diagnosis.attribution.gather import FREE_AIR, require_joints
from diagnosis.attribution.rules import rules
from diagnosis.attribution.sound import Sound
from diagnosis.attribution.verdict import NONE
from diagnosis.calibration.worlds import Simulate
from diagnosis.diagnose import (
    Diagnosis,
    Judge,
    Judged,
    SideBySide,
    diagnose,
    diagnose_settings,
    healthy,
)
from diagnosis.logs.log import HandMechanism, Log, LogError, read_log
from diagnosis.replay.agreement import apart_rad
from diagnosis.replay.nominal import left_out, mjcf_world, own_catalogue
from diagnosis.report import wording
from diagnosis.report.report import page
from diagnosis.report.wording import sentence

FILE, REPORT = "diagnosis.json", "report.html"
OUT = Path("diagnoses")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of `bench diagnose`."""

    paths: tuple[Path, ...]
    """Folders of the logs: one, or one per setting of the mechanism."""
    judging: tuple[Path, ...] = ()
    """The logs on which candidates are judged, if there are several; the others are used in
    fits."""
    nominal: str
    """Engine that the compiled replay of the nominal world is compared with."""
    known_effects: str | None
    """Effects that the nominal world is known to have; None: those named in the log."""
    workers: int | None
    healthy: tuple[Path, ...] = ()
    """Folders of logs of the same mechanism, recorded while nothing was wrong with it."""

    @property
    def words(self) -> str:
        """The logs as written on the command line."""
        judging = (f"--judge {path}" for path in self.judging)
        healthy = (f"--healthy {path}" for path in self.healthy)
        return " ".join([*map(str, self.paths), *judging, *healthy])


@dataclass(frozen=True, kw_only=True)
class World:
    """The nominal world."""

    spec: Spec
    ideal: Spec
    """The same without its effects."""
    known: str
    """Its effects."""


def run(settings: Settings, out: Path | None, force: bool) -> tuple[dict, RenderableType]:
    """Diagnose and write diagnosis.json and report.html; returns the result and its summary.

    Raises UsageError for a log or setting that cannot be used, CommandError if a process stops.
    """
    judging = _judging(settings)
    main = judging[0] if judging else 0
    folder = out or OUT / settings.paths[main].resolve().name
    if (folder / FILE).exists() and not force:
        raise UsageError(f"{folder / FILE} exists; choose another --out, or --force to replace it")
    engine = registry.load("backend", settings.nominal)
    workers = settings.workers or usable_cores()
    try:
        logs = [read_log(path) for path in settings.paths]
        worlds = [_world(log, settings) for log in logs]
        catalogue = _catalogue()
        for world in worlds:
            catalogue = own_catalogue(catalogue, world.spec)
        pairs = list(zip(logs, worlds, strict=True))
        gaps = [_apart_rad(*pair, settings.nominal, engine, workers) for pair in pairs]
        apart = max((gap for gap in gaps if gap is not None), default=None)
        sound = _sound(settings, pairs[main], catalogue, workers)
        limbs, (log, world) = _side_by_side(settings.paths[main].name, workers), pairs[main]
        if judging:
            every = [(one, its.spec) for one, its in pairs]
            found = diagnose_settings(every, judging, catalogue, limbs, sound)
        else:
            found = diagnose(log, world.spec, catalogue, limbs, _on(engine, workers), sound)
    except LogError as error:
        raise UsageError(str(error)) from error
    except (WorkerError, BrokenProcessPool) as error:
        raise CommandError(f"a process of the diagnosis stopped: {error}") from error
    log = dataclasses.replace(log, warnings=(*log.warnings, *_warnings(log, world, apart)))
    result = _result(folder, found, log, world, settings, apart)
    folder.mkdir(parents=True, exist_ok=True)
    whole = result | {"rules": rules().model_dump(mode="json"), "provenance": provenance()}
    text = page(found, log, _facts(result, log, settings), result["next"])
    write_atomically(folder / REPORT, text)
    write_atomically(folder / FILE, json.dumps(whole, indent=1, allow_nan=False) + "\n")
    return result, summary(found, result)


def _judging(settings: Settings) -> list[int]:
    """Numbers of the logs on which candidates are judged; empty for a single log.

    Raises UsageError.
    """
    paths = [path.resolve() for path in settings.paths]
    twice = [str(path) for path in settings.paths if paths.count(path.resolve()) > 1]
    if twice:
        raise UsageError(f"{twice[0]} is given twice; give each log once")
    for path in settings.judging:
        if path.resolve() not in paths:
            raise UsageError(f"--judge {path} is not among the logs; give one of: {settings.words}")
    if len(paths) > 1 and not settings.judging:
        raise UsageError(
            f"{len(paths)} logs are given, and --judge names none of them; name the log on which "
            f"candidates are judged, such as --judge {settings.paths[-1]}; the others are fitted"
        )
    if settings.judging and len({path.resolve() for path in settings.judging}) == len(paths):
        raise UsageError("--judge names every log; leave at least one for fitting")
    return sorted({paths.index(path.resolve()) for path in settings.judging})


def _sound(
    settings: Settings,
    diagnosed: tuple[Log, World],
    catalogue: Mapping[str, type[Effect]],
    workers: int,
) -> tuple[Sound, ...]:
    """The residuals of every limb in the healthy logs; raises UsageError or LogError.

    Healthy logs must have the joints, protocols and channels of the log that is diagnosed.
    """
    paths = [path.resolve() for path in settings.paths]
    if both := [path for path in settings.healthy if path.resolve() in paths]:
        raise UsageError(
            f"--healthy {both[0]} is the log that is diagnosed; give logs of the same mechanism "
            "recorded while nothing was wrong"
        )
    today, world = diagnosed
    logs = [read_log(path) for path in settings.healthy]
    pairs = [(log, _world(log, settings).spec) for log in logs]
    for path, (log, spec) in zip(settings.healthy, pairs, strict=True):
        if spec.hand.joint_names != world.spec.hand.joint_names:
            raise UsageError(
                f"--healthy {path} has the joints {', '.join(spec.hand.joint_names)}, and the log "
                f"that is diagnosed has {', '.join(world.spec.hand.joint_names)}; give logs of "
                "the same mechanism"
            )
        for what, asked, there in (
            ("protocols", _protocols(today), _protocols(log)),
            ("channels", _read(today), _read(log)),
        ):
            if lacking := sorted(asked - there):
                raise UsageError(
                    f"--healthy {path} lacks the {what} {', '.join(lacking)} of the log that is "
                    "diagnosed; record the healthy log with the same protocols and channels"
                )
    return healthy(pairs, catalogue, _side_by_side("healthy logs", workers)) if pairs else ()


def _protocols(log: Log) -> set[str]:
    """Protocols of a log in free air."""
    return {e.protocol for e in log.episodes} & set(FREE_AIR)


def _read(log: Log) -> set[str]:
    """Channels of a log with which replays are compared."""
    return {kind for kind in USED if any(log.has(kind, joint) for joint in log.joints)}


def _catalogue() -> dict[str, type[Effect]]:
    return {name: registry.load("effect", name) for name in registry.names("effect")}


def _world(log: Log, settings: Settings) -> World:
    """The nominal world: the mechanism that the log names, with the known effects.

    Raises UsageError or LogError.
    """
    mechanism = log.meta.mechanism
    if isinstance(mechanism, HandMechanism):
        if mechanism.hand not in HANDS:
            raise unknown("hand", mechanism.hand, HANDS)
        if mechanism.stick not in STICKS:
            raise unknown("stick", mechanism.stick, STICKS)
        ideal: Spec = HANDS[mechanism.hand].spec(STICKS[mechanism.stick])
        require_joints(log, ideal)
        named = mechanism.effects
    else:
        ideal, named = mjcf_world(log), NONE
    known = named if settings.known_effects is None else settings.known_effects
    spec = with_effects(ideal, parse_effects(known, ideal.hand))
    return World(spec=spec, ideal=ideal, known=known)


def _side_by_side(name: str, workers: int) -> SideBySide:
    """Judge limbs on several cores with a progress bar; the processes end with the last limb."""

    def judged(judge: Judge, parts: Sequence[Evidence]) -> Iterator[Judged]:
        jobs = processes(workers, len(parts))
        with Bar(f"diagnose {name}", len(parts)) as bar:
            bar.update(0, f"fitting {', '.join(j for part in parts for j in part.joints)}")
            for done, one in enumerate(_results(judge, parts, jobs), start=1):
                bar.update(done, f"{', '.join(parts[done - 1].joints)}: {one.verdict.names[0]}")
                yield one

    return judged


def processes(cores: int, limbs: int) -> int:
    """Number of processes that judge limbs: one more than cores.

    Three fingers in two processes on two cores would take two rounds, the second with one idle
    core. With three processes both cores stay busy.
    """
    return 1 if cores == 1 else min(cores + 1, limbs)


def _results(judge: Judge, parts: Sequence[Evidence], jobs: int) -> Iterator[Judged]:
    if jobs == 1:
        yield from map(judge, parts)
        return
    try:
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator", max_nbytes=None)
        yield from parallel(joblib.delayed(judge)(part) for part in parts)
    finally:  # their CPU time counts as ours once they have ended
        get_reusable_executor().shutdown(wait=True, kill_workers=True)


def _apart_rad(
    log: Log, world: World, name: str, engine: type[Engine], workers: int
) -> float | None:
    """Largest distance between replay and engine [rad]; UsageError where it refuses the world.

    None for a world with slides on an engine that builds only hinges; replays do both.
    """
    if _slides(world) and engine.support["joint.slides"].startswith("refused"):
        return None
    try:
        return apart_rad(_on(engine, workers), world.spec, log)
    except ValueError as error:
        raise UsageError(f"--nominal {name}: {error}; choose another engine") from error


def _on(engine: type[Engine], workers: int) -> Simulate:
    """Worlds on the nominal engine."""
    return lambda specs: simulate(engine, specs, workers)


def _slides(world: World) -> str:
    """Names of the joints that slide."""
    return ", ".join(body.joint.name for body in world.spec.hand.driven if body.joint.slides)


def _warnings(log: Log, world: World, apart_rad: float | None) -> Iterator[str]:
    known, floor_rad = world.spec.hand.joint_names, rules().floor_position_rad
    if strange := [joint for joint in log.joints if joint not in known]:
        yield f"the log has joints that this hand lacks: {', '.join(strange)}; they are ignored"
    if not isinstance(log.meta.mechanism, HandMechanism):
        yield from (f"not simulated from the MJCF: {text}" for text in left_out(log))
    if slides := _slides(world):
        yield f"{slides} is a slide: read N for Nm and m for rad, so 17.45 mm for 1 deg"
    if apart_rad is None:
        yield f"{_slides(world)} is a slide, which no engine here builds: replays are not checked"
    elif apart_rad > floor_rad:
        yield (
            f"the engine and the compiled replay of the nominal world differ by up to "
            f"{1e3 * apart_rad:.2g} mrad (slides: mm); the diagnosis counts up to "
            f"{1e3 * floor_rad:g} as no difference"
        )


def _result(
    folder: Path,
    found: Diagnosis,
    log: Log,
    world: World,
    settings: Settings,
    apart_rad: float | None,
) -> dict:
    """The JSON object."""
    row, effects = found.row(), _corrected(found, world)
    return {
        "status": "done",
        "dir": str(folder),
        "written": [str(folder / FILE), str(folder / REPORT)],
        "log": settings.words,
        "nominal": {
            "backend": settings.nominal,
            "hand": world.spec.hand.name,
            "effects": world.known,
            "replay_apart_rad": apart_rad,
        },
        "healthy": _healthy(found, settings),
        "verdict": row.pop("verdict"),
        "effects": effects,
        "next": _commands(effects, log, settings),
        "sentence": sentence(found),
        "warnings": list(log.warnings),
        **row,
    }


def _healthy(found: Diagnosis, settings: Settings) -> dict:
    """The residuals of every limb in healthy logs, and the rules that follow from them."""
    attributed = (limb.attribution for limb in found.limbs)
    limbs = [(one.fitter.evidence, one.rule) for one in attributed]
    return {
        "logs": list(map(str, settings.healthy)),
        "limbs": [
            {
                "joints": list(evidence.joints),
                "left": dataclasses.asdict(evidence.sound),
                "excused": [_excused(name, evidence.sound) for name in evidence.sound.sizes],
                "rules": rule.model_dump(mode="json", exclude={"right", "version"}),
            }
            for evidence, rule in limbs
            if evidence.sound is not None
        ],
    }


def _excused(effect: str, sound: Sound) -> dict:
    """The largest magnitude of an effect that a healthy mechanism may have."""
    unit = registry.load("effect", effect).unit
    return {
        "effect": effect,
        "magnitude": sound.most(effect, rules()) / UNITS[unit][1],
        "unit": unit,
    }


def _corrected(found: Diagnosis, world: World) -> str | None:
    """The corrected world as effects; None if there is nothing to add, or if it cannot be added."""
    if not found.magnitudes:
        return None
    try:
        return effects_text(world.known, found.magnitudes, world.ideal)
    except UsageError:
        return None


def _facts(result: dict, log: Log, settings: Settings) -> dict[str, str]:
    """What the report says about log and nominal world."""
    nominal = result["nominal"]
    apart_rad, name = nominal["replay_apart_rad"], nominal["backend"]
    held = f"not compared with {name}, which builds no slides"
    if apart_rad is not None:
        held = f"within {1e3 * apart_rad:.2g} mrad of {name} in the nominal world"
    return {
        "log": settings.words if settings.judging else settings.paths[0].resolve().name,
        "source": log.meta.source,
        "nominal world": f"{nominal['hand']}, known effects: {nominal['effects']}",
        "replay": f"compiled; {held}",
        **(
            {"healthy logs": wording.healthy(result["healthy"], rules())}
            if settings.healthy
            else {}
        ),
        "uncertainty": f"{100 * log.meta.nominal_uncertainty:g} % of every nominal parameter",
        "made by": provenance()["command"],
    }


def _commands(text: str | None, log: Log, settings: Settings) -> dict[str, str]:
    """Commands that use the effects of the corrected world, and what each does."""
    if text is None:
        return {}
    further = {f"bench diagnose {settings.words} --known-effects {text}": "diagnose what is left"}
    if not isinstance(log.meta.mechanism, HandMechanism):
        return further
    train = f"bench run --backend {settings.nominal} --task circle --effects {text}"
    return {
        train: "train a policy in the corrected world",
        f"bench eval RUN --effects {text}": "evaluate a policy in the corrected world",
    } | further
