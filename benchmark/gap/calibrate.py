"""`bench calibrate`: fit a log and write calibration.yaml, a picture per joint and a table."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import RenderableType

from backends.effect import with_effects
from backends.engine import Simulator
from backends.shard import WorkerError, simulate
from backends.spec import Spec
from benchmark.console import Bar
from benchmark.errors import CommandError, UsageError
from benchmark.gap import _calibration_texts as texts
from benchmark.gap.asked import Calibration as Asked
from benchmark.parts import registry
from benchmark.provenance import usable_cores
from benchmark.settings.effects import (
    EffectSet,
    parse_effects,
    parse_spread,
    read_effects,
    refuse,
)
from benchmark.settings.run_spec import ideal
from diagnosis.calibration import plot
from diagnosis.calibration.calibrate import ROUNDS, Calibration, calibrate
from diagnosis.calibration.result import (
    CalibrationFile,
    read_calibration,
    write_calibration,
)
from diagnosis.logs.log import HandMechanism, Log, LogError, read_log
from diagnosis.replay.nominal import mjcf_world

FILE = "calibration.yaml"
OUT = Path("calibrations")
BEYOND = {
    "joint.slides": "not a hinge",
    "joint.follows": "follows another joint",
    "body.carried": "its weight is carried",
}
"""Numbers that engines may refuse, and what they mean."""


def run(
    asked: Asked, seed: int, out: Path | None, force: bool, workers: int | None
) -> tuple[dict, RenderableType]:
    """Calibrate and write calibration.yaml and pictures; returns the result and its table.

    Raises UsageError for a log or setting that cannot be used, CommandError if an engine stops.
    """
    folder = out or OUT / asked.log.resolve().name
    _refuse_taken(folder, force)
    engine = registry.load("backend", asked.nominal)
    cores = workers or usable_cores()

    def start(specs: Sequence[Spec]) -> Simulator:
        return simulate(engine, specs, cores)

    try:
        log = read_log(asked.log)
        ideal = _ideal(log, asked.nominal)
        known = read_effects(_known_effects(log, asked), ideal.hand)
        refuse(known.effects, engine.support, asked.nominal)
        with Bar(f"calibrate {asked.log.name}", ROUNDS) as bar:
            found = calibrate(
                start,
                with_effects(ideal, known.effects),
                log,
                asked.threshold_m,
                np.random.default_rng(seed),
                bar.update,
            )
            content = _content(found, log, ideal, known, asked, seed)
            folder.mkdir(parents=True, exist_ok=True)
            pictures = plot.draw(found, folder)
        write_calibration(folder / FILE, content)
    except LogError as error:
        raise UsageError(str(error)) from error
    except WorkerError as error:
        raise CommandError(f"the simulation on {asked.nominal} stopped: {error}") from error
    result = {
        "status": "done",
        "dir": str(folder),
        "written": [str(folder / FILE), *map(str, pictures)],
        "warnings": list(log.warnings),
        **content.model_dump(mode="json", by_alias=True),
    }
    return result, texts.table(content)


def world_of(path: Path, hand: str) -> dict[str, str]:
    """Effects and spread of a calibration, as fields of a RunSpec for `hand`. Raises UsageError."""
    try:
        found = read_calibration(path)
        if found.hand != hand:
            raise UsageError(f"it is a calibration of '{found.hand}', not of '{hand}'")
    except (LogError, UsageError) as error:
        raise UsageError(f"--calibration {path}: {error}") from error
    return {"effects": found.effects, "spread": found.spread}


def _refuse_taken(folder: Path, force: bool) -> None:
    if (folder / FILE).exists() and not force:
        raise UsageError(f"{folder / FILE} exists; choose another --out, or --force to replace it")


def _ideal(log: Log, backend: str) -> Spec:
    """The log's mechanism without effects; raises UsageError or LogError if it is unknown."""
    mechanism = log.meta.mechanism
    if not isinstance(mechanism, HandMechanism):
        spec = mjcf_world(log, geared=True)
        support = registry.load("backend", backend).support
        for number, what in BEYOND.items():
            values = zip(spec.hand.bodies, spec.values(number), strict=True)
            joints = [body.joint.name for body, value in values if value]
            if joints and support[number].startswith("refused"):
                raise UsageError(
                    f"{what}: {', '.join(joints)}; {backend} simulates hinges only; "
                    "`bench diagnose` takes all and refits their nominal parameters"
                )
        return spec
    return ideal(mechanism.hand, mechanism.stick)


def _known_effects(log: Log, asked: Asked) -> str:
    if asked.known_effects is not None:
        return asked.known_effects
    mechanism = log.meta.mechanism
    return mechanism.effects if isinstance(mechanism, HandMechanism) else "none"


def _content(
    found: Calibration, log: Log, ideal: Spec, known: EffectSet, asked: Asked, seed: int
) -> CalibrationFile:
    content = CalibrationFile(
        schema=1,
        log=str(asked.log),
        source=log.meta.source,
        backend=asked.nominal,
        hand=ideal.hand.name,
        stick=ideal.stick.name,
        nominal_effects=known.text,
        seed=seed,
        effects=texts.effects_text(found, ideal, known.effects),
        spread=texts.spread_text(found),
        joints=found.joints,
        tactile=found.touch,
    )
    parse_effects(content.effects, ideal.hand)
    parse_spread(content.spread, ideal.hand)
    return content
