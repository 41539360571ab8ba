"""The options of `bench calibrate` and `diagnose`: what a log says of the nominal world."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import Force, Json, Log, NominalEffects, Workers
from benchmark.console import emit


def calibrate(
    log: Log,
    backend: Annotated[
        str, typer.Option(help="Physics engine that stands for the nominal world.")
    ] = "mujoco",
    nominal_effects: NominalEffects = None,
    threshold: Annotated[
        str | None,
        typer.Option(help="Pressed depth that counts as contact, such as 0.3mm. (from the noise)"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Decides every draw of the search.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder to write to. (calibrations/LOG)")] = None,
    force: Force = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Calibrate the nominal world to a log: gains by CMA-ES, play by the push test, and the skin.

    Writes calibration.yaml, which `bench run --calibration` takes, and a picture per joint.

    Example: [bold]bench calibrate logs/one --out calibrations/one[/bold]
    """
    from benchmark import calibrate as calibrations

    settings = calibrations.Settings(
        path=log,
        backend=backend,
        nominal_effects=nominal_effects,
        threshold=threshold,
        seed=seed,
        workers=workers,
    )
    result, table = calibrations.run(settings, out, force)
    emit(result, as_json, table)


def diagnose(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG",
            help="Folder of the log; several of one mechanism under several settings with --judge.",
        ),
    ],
    judge: Annotated[
        list[Path] | None,
        typer.Option(help="Of several logs one that judges; the others are fitted. (repeatable)"),
    ] = None,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            help="Log of the same mechanism, moved alike, while nothing was wrong with it: what it "
            "leaves is not accused. (repeatable)"
        ),
    ] = None,
    nominal: Annotated[
        str,
        typer.Option(
            help="Engine of the nominal world. Replays are compiled, for any engine alike; the "
            "nominal one is held against this engine, and a difference that matters is a warning."
        ),
    ] = "mujoco",
    effects_known: NominalEffects = None,
    out: Annotated[Path | None, typer.Option(help="Folder to write to. (diagnoses/LOG)")] = None,
    force: Force = False,
    workers: Annotated[
        int | None, typer.Option(help="Cores to judge fingers on; changes no result. (all)", min=1)
    ] = None,
    as_json: Json = False,
) -> None:
    """Say where a log departs from the nominal world, which effect explains it, and how well.

    Writes diagnosis.json and report.html.

    Example: [bold]bench diagnose logs/one --effects-known built[/bold]

    A robot that was fine: [bold]bench diagnose logs/today --healthy logs/may[/bold]

    Settings: [bold]bench diagnose logs/gain100 logs/gain400 --judge logs/gain400[/bold]
    """
    from benchmark import diagnose as diagnoses

    settings = diagnoses.Settings(
        paths=tuple(logs),
        judging=tuple(judge or ()),
        healthy=tuple(healthy or ()),
        nominal=nominal,
        effects_known=effects_known,
        workers=workers,
    )
    result, summary = diagnoses.run(settings, out, force)
    emit(result, as_json, summary)
