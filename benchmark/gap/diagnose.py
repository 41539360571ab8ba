"""`bench diagnose`: from a log to diagnosis.json, report.html and a summary."""

import dataclasses
import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import RenderableType

from backends.catalogue import catalogue
from backends.effect import with_effects
from backends.shard import WorkerError, simulate
from backends.spec import Spec
from benchmark.console import Bar, patient, say
from benchmark.errors import CommandError, Interrupted, UsageError
from benchmark.gap import robot_log
from benchmark.gap._diagnosis_texts import effects_text, summary
from benchmark.gap.asked import Diagnosis as Asked
from benchmark.gap.take_home import FILE as CORRECTED
from benchmark.gap.take_home import ROBOT, URDF, TakeHome, take_home
from benchmark.parts import registry
from benchmark.provenance import provenance, usable_cores
from benchmark.settings.effects import EffectSet, read_effects
from benchmark.settings.run_spec import ideal as world_of
from diagnosis.answer import Diagnosis
from diagnosis.evidence.evidence import FLOOR_RAD
from diagnosis.logs.log import HandMechanism, Log, LogError
from diagnosis.motion.batch import Simulate
from diagnosis.motion.recordings import CHANNELS, FREE_AIR, require_joints
from diagnosis.progress import Stop
from diagnosis.replay.agreement import apart_rad
from diagnosis.replay.nominal import left_out, mjcf_world, own_catalogue
from diagnosis.replay.plain import plain_apart
from diagnosis.replay.robot import contradictions
from diagnosis.report.report import page
from diagnosis.verdict.result import NONE, distance
from diagnosis.walk import diagnose
from files.atomic import write_atomically

FILE, REPORT = "diagnosis.json", "report.html"
OUT = Path("diagnoses")
GAPS = "from {} to {} over the log"


@dataclass(frozen=True, kw_only=True)
class World:
    """The nominal world."""

    spec: Spec
    ideal: Spec
    """The same without its effects."""
    known: EffectSet
    """Its effects."""


def run(asked: Asked, out: Path | None, force: bool) -> tuple[dict, RenderableType]:
    """Diagnose and write diagnosis.json and report.html; returns the result and its summary.

    Raises UsageError for a log or setting that cannot be used, CommandError if a process stops.
    """
    folder = out or OUT / asked.name
    path = asked.folder or folder / robot_log.FOLDER
    if (folder / FILE).exists() and not force:
        raise UsageError(f"{folder / FILE} exists; choose another --out, or --force to replace it")
    try:
        log = _understood(asked, folder, force)
        if log.meta.mechanism is None:
            from benchmark.gap import without_model  # draws with matplotlib, which takes its time

            healthy = [robot_log.read_beside(one, asked, log) for one in asked.healthy]
            return without_model.run(log, path, asked.healthy, healthy, folder)
        world = nominal_world(log, asked.known_effects)
        healthy = _healthy(asked, path, log, world)
        apart = _apart_rad(log, world, asked.nominal)
        with Bar(f"diagnose {asked.name}", 100) as bar, patient() as is_stopped:

            def tell(text: str, share: float) -> None:
                bar.update(round(100 * share), text)
                if is_stopped():
                    raise Stop

            found = diagnose(
                log,
                healthy,
                nominal=world.spec,
                catalogue=own_catalogue(catalogue(), world.spec),
                simulate=_on(asked.nominal),
                progress=tell,
            )
    except Stop:
        raise KeyboardInterrupt from None
    except LogError as error:
        raise UsageError(str(error)) from error
    except WorkerError as error:
        raise CommandError(f"a process of the diagnosis stopped: {error}") from error
    log = dataclasses.replace(log, warnings=(*log.warnings, *_warnings(log, world, apart)))
    result = _result(folder, found, log, world, asked, path, apart)
    folder.mkdir(parents=True, exist_ok=True)
    if not isinstance(log.meta.mechanism, HandMechanism):
        home = take_home(log, world.spec, found, own_catalogue(catalogue(), world.spec))
        result["model"] = _kept(folder, home, result)
    text = page(found, log, _facts(result, log, world.spec, asked), result["next"])
    write_atomically(folder / REPORT, text)
    whole = result | {"provenance": provenance()}
    write_atomically(folder / FILE, json.dumps(whole, indent=1, allow_nan=False) + "\n")
    if found.stopped:
        raise Interrupted(
            f"stopped; known so far: {' '.join(found.sentences[1:3])} The rest is in "
            f"{folder / REPORT} and {folder / FILE}"
        )
    return result, summary(found, result)


def _understood(asked: Asked, folder: Path, force: bool) -> Log:
    """The log; of two files, what was understood of them is said first."""
    found = robot_log.read(asked, folder, force)
    if found.said:
        for line in (*found.said, *robot_log.understood(found.log)):
            say(line)
        say(f"as a log, with a log.yaml to edit: {found.folder}")
    return found.log


def _healthy(asked: Asked, log_path: Path, today: Log, world: World) -> list[Log]:
    """The healthy logs; raises UsageError or LogError.

    They must have the joints, protocols and channels of the log that is diagnosed.
    """
    if same := [path for path in asked.healthy if path.resolve() == log_path.resolve()]:
        raise UsageError(
            f"--healthy {same[0]} is the log that is diagnosed; give logs of the same mechanism "
            "recorded while nothing was wrong"
        )
    logs = [robot_log.read_beside(path, asked, today) for path in asked.healthy]
    for path, log in zip(asked.healthy, logs, strict=True):
        names = nominal_world(log, asked.known_effects).spec.hand.joint_names
        if names != world.spec.hand.joint_names:
            raise UsageError(
                f"--healthy {path} has the joints {', '.join(names)}, and the log "
                f"that is diagnosed has {', '.join(world.spec.hand.joint_names)}; give logs of "
                "the same mechanism"
            )
        for what, wanted, there in (
            ("protocols", _protocols(today), _protocols(log)),
            ("channels", _read(today), _read(log)),
        ):
            if lacking := sorted(wanted - there):
                raise UsageError(
                    f"--healthy {path} lacks the {what} {', '.join(lacking)} of the log that is "
                    "diagnosed; record the healthy log with the same protocols and channels"
                )
    return logs


def _protocols(log: Log) -> set[str]:
    """Protocols of a log in free air."""
    return {e.protocol for e in log.episodes} & set(FREE_AIR)


def _read(log: Log) -> set[str]:
    """Channels of a log with which replays are compared."""
    return {kind for kind in CHANNELS if any(log.has(kind, joint) for joint in log.joints)}


def nominal_world(log: Log, known_effects: str | None) -> World:
    """The nominal world: the mechanism that the log names, with the known effects.

    `known_effects` are None for those that the log names. Raises UsageError or LogError.
    """
    mechanism = log.meta.mechanism
    if isinstance(mechanism, HandMechanism):
        ideal = world_of(mechanism.hand, mechanism.stick)
        require_joints(log, ideal.hand.joint_names)
        named = mechanism.effects
    else:
        ideal, named = mjcf_world(log), NONE
    given = named if known_effects is None else known_effects
    known = read_effects(given, ideal.hand, own_catalogue(catalogue(), ideal))
    spec = with_effects(ideal, known.effects)
    return World(spec=spec, ideal=ideal, known=known)


def _apart_rad(log: Log, world: World, name: str) -> float:
    """Largest distance between replay and engine [rad]; UsageError where it refuses the world.

    A user's robot is held against plain MuJoCo.
    """
    if not isinstance(log.meta.mechanism, HandMechanism):
        return plain_apart(log, world.spec)
    try:
        return apart_rad(_on(name), world.spec, log)
    except LogError:
        raise
    except ValueError as error:
        raise UsageError(f"--nominal {name}: {error}; choose another engine") from error


def _on(name: str) -> Simulate:
    """Worlds on the nominal engine, which is loaded where a log needs it."""
    return lambda specs: simulate(registry.load("backend", name), specs, usable_cores())


def _warnings(log: Log, world: World, apart_rad: float) -> Iterator[str]:
    known = world.spec.hand.joint_names
    if strange := [joint for joint in log.joints if joint not in known]:
        yield f"the log has joints that this hand lacks: {', '.join(strange)}; they are ignored"
    if not isinstance(log.meta.mechanism, HandMechanism):
        yield from contradictions(log)
        yield from (f"not simulated from the MJCF: {text}" for text in left_out(log))
    if apart_rad > FLOOR_RAD:
        yield (
            f"the engine and the compiled replay of the nominal world differ by up to "
            f"{distance(apart_rad, world.spec)}; the diagnosis counts up to "
            f"{distance(FLOOR_RAD, world.spec)} as no difference{_why_apart(log, world)}"
        )


def _why_apart(log: Log, world: World) -> str:
    """Why MuJoCo shows something else than the replay; empty where no reason is known."""
    rubs = any(drive.coulomb_nm > 0.0 for drive in world.spec.drives)
    if isinstance(log.meta.mechanism, HandMechanism) or not rubs:
        return ""
    return (
        ": a joint that its frictionloss holds creeps in MuJoCo; the fit says whether it did here"
    )


def _result(
    folder: Path,
    found: Diagnosis,
    log: Log,
    world: World,
    asked: Asked,
    path: Path,
    apart_rad: float,
) -> dict:
    """The JSON object."""
    row, effects = found.plain(), _corrected(found, world)
    return {
        "status": "stopped" if found.stopped else "done",
        "dir": str(folder),
        "written": [str(folder / FILE), str(folder / REPORT)],
        "log": _words(asked, path),
        "nominal": {
            "backend": asked.nominal,
            "hand": world.spec.hand.name,
            "effects": world.known.text,
            "replay_apart_rad": apart_rad,
        },
        "healthy": list(map(str, asked.healthy)),
        "verdict": list(row.pop("verdict")),
        "effects": effects,
        "next": _commands(effects, folder, log, asked, path),
        "sentence": " ".join(found.sentences),
        "warnings": list(log.warnings),
        **row,
    }


def _kept(folder: Path, home: TakeHome | None, result: dict) -> dict | None:
    """Write the corrected model; what is said of it."""
    if home is None:
        return None
    for name, text in ((CORRECTED, home.text), (URDF, home.urdf), (ROBOT, home.robot)):
        if text is not None:
            write_atomically(folder / name, text)
            result["written"].append(str(folder / name))
    return home.plain() | {"file": str(folder / CORRECTED), "words": home.words}


def _corrected(found: Diagnosis, world: World) -> str | None:
    """The corrected world as effects; None if there is nothing to add, or if it cannot be added."""
    if not found.magnitudes:
        return None
    try:
        kinds = own_catalogue(catalogue(), world.ideal)
        return effects_text(world.known, found.magnitudes, world.ideal, kinds)
    except UsageError:
        return None


def _facts(result: dict, log: Log, spec: Spec, asked: Asked) -> dict[str, str]:
    """What the report says about log and nominal world."""
    nominal = result["nominal"]
    gaps = [distance(gap, spec) for gap in result["engine_gaps_rad"]]
    model = result.get("model")
    apart, name = distance(nominal["replay_apart_rad"], spec), nominal["backend"]
    held = f"within {apart} of {name} in the nominal world"
    return {
        "log": asked.name,
        "source": log.meta.source,
        "nominal world": f"{nominal['hand']}, known effects: {nominal['effects']}",
        "replay": f"compiled; {held}",
        **({"corrected gap in the engine": GAPS.format(*gaps)} if gaps else {}),
        **({"corrected model": "; ".join(model["words"])} if model else {}),
        **({"healthy logs": ", ".join(result["healthy"])} if asked.healthy else {}),
        "uncertainty": f"{100 * log.meta.nominal_uncertainty:g} % of every nominal number",
        "made by": provenance()["command"],
    }


def _words(asked: Asked, path: Path) -> str:
    """The logs as written on the command line."""
    healthy = (word for one in asked.healthy for word in ("--healthy", str(one)))
    return shlex.join([str(path), *healthy])


def _commands(text: str | None, folder: Path, log: Log, asked: Asked, path: Path) -> dict[str, str]:
    """Commands that use the effects of the corrected world, and what each does."""
    if text is None:
        return {}
    known = shlex.join(["--known-effects", text, "--out", f"{folder}-corrected"])
    further = {f"bench diagnose {_words(asked, path)} {known}": "diagnose what is left"}
    if not isinstance(log.meta.mechanism, HandMechanism):
        return further
    train = f"bench run --backend {asked.nominal} --task circle --effects {text}"
    return {
        train: "train a policy in the corrected world",
        f"bench eval RUN --effects {text}": "evaluate a policy in the corrected world",
    } | further
