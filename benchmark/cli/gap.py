"""`bench calibrate` and `diagnose`: what a log says of the nominal world."""

from pathlib import Path
from typing import Annotated, Any

import typer

from benchmark.cli.command import command
from benchmark.cli.options import Force, KnownEffects, Log, Nominal, Out, Seed, Workers
from benchmark.errors import UsageError

CAUSE, UNKNOWN = "cause", "unknown"
OF_LOG = "those that the log names"


LogFolder = Annotated[
    Path | None, typer.Argument(metavar="[LOG]", help="Folder of the log.", show_default=False)
]
Robot = Annotated[
    Path | None, typer.Option("--robot", metavar="MODEL", help="MJCF or URDF of the robot.")
]
Table = Annotated[
    Path | None,
    typer.Option("--log", metavar="TABLE", help="What it recorded, as CSV or parquet."),
]
Unit = Annotated[
    str | None,
    typer.Option(metavar="UNIT", help="Of positions and commands: rad, deg, turn, mrad, m, mm."),
]
Column = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINT.KIND=COLUMN",
        help="Which column it is; kinds: command, position, motor, torque, velocity, push, "
        "reference, feedforward; repeatable.",
    ),
]
DriveOf = Annotated[
    list[str] | None,
    typer.Option(
        "--drive",
        metavar="JOINT=NUMBERS",
        help="Numbers of a drive that the model lacks, such as "
        "'*=kp:60+-20%,kd:1.5,limit:12,ki:5'; repeatable.",
    ),
]
ServoOf = Annotated[
    list[str] | None,
    typer.Option(
        "--servo",
        metavar="NAME@JOINT",
        help="A servo that is known, such as 'sts3215@*' or 'xl330,gain:800,volts:5.1@wrist'; "
        "repeatable.",
    ),
]
Hold = Annotated[
    list[str] | None,
    typer.Option(
        metavar="JOINT=POSITION", help="Where a joint is held that the table lacks; repeatable."
    ),
]
FixBase = Annotated[
    bool, typer.Option("--fix-base", help="Hold a floating base where the model has it.")
]
GravityCompensation = Annotated[
    bool,
    typer.Option(
        "--gravity-compensation", help="The drives carry the links' weight by themselves."
    ),
]
OF_FILES = {
    "robot": "none",
    "table": "none",
    "unit": "as the names say, or as the ranges do",
    "column": "by their names",
    "drive": "the model's",
    "servo": "none",
    "hold": "where the model has them",
}


@command(
    defaults={
        "known_effects": OF_LOG,
        "threshold": "from the noise",
        "out": "calibrations/LOG",
    }
)
def calibrate(
    log: Log,
    nominal: Nominal = "mujoco",
    known_effects: KnownEffects = None,
    threshold: Annotated[
        str | None,
        typer.Option(metavar="LENGTH", help="Pressed depth that counts as contact, such as 0.3mm."),
    ] = None,
    seed: Seed = 0,
    out: Out = None,
    force: Force = False,
    workers: Workers = None,
) -> Any:
    """Calibrate the nominal world to a log: gains by CMA-ES, play by the push test, and the skin.

    Writes calibration.yaml, which `bench run --calibration` takes, and a picture per joint.

    Example: [bold]bench calibrate logs/one --out calibrations/one[/bold]
    """
    from benchmark.gap import calibrate as calibrations

    settings = calibrations.Settings(
        path=log,
        nominal=nominal,
        known_effects=known_effects,
        threshold=threshold,
        seed=seed,
        workers=workers,
    )
    return calibrations.run(settings, out, force)


@command(
    defaults={
        "known_effects": OF_LOG,
        "out": "diagnoses/LOG",
        "healthy": "none",
        "fail_on": "nothing",
        **OF_FILES,
    }
)
def diagnose(
    log: LogFolder = None,
    robot: Robot = None,
    table: Table = None,
    unit: Unit = None,
    column: Column = None,
    drive: DriveOf = None,
    servo: ServoOf = None,
    hold: Hold = None,
    fix_base: FixBase = False,
    gravity_compensation: GravityCompensation = False,
    healthy: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="Log of the same mechanism, moved alike, while nothing was wrong: residuals that "
            "such a log also shows are not attributed to a fault; repeatable.",
        ),
    ] = None,
    nominal: Nominal = "mujoco",
    known_effects: KnownEffects = None,
    fail_on: Annotated[
        str | None,
        typer.Option(
            metavar="VERDICTS",
            help="Exit with 1 at these verdicts, between commas: cause, unknown.",
        ),
    ] = None,
    out: Out = None,
    force: Force = False,
) -> Any:
    """Say where a log departs from the nominal world, which effect explains it, and how well.

    LOG is a folder, or a robot's model and the table that it recorded make one.

    Writes diagnosis.json and report.html. Replays are compiled, for any engine alike; the nominal
    one is held against them, and a difference that matters is a warning.

    Example: [bold]bench diagnose --robot arm.xml --log run.csv[/bold]

    A log folder: [bold]bench diagnose logs/one --known-effects built[/bold]

    A robot that was fine: [bold]bench diagnose logs/today --healthy logs/may[/bold]
    """
    from benchmark.gap import diagnose as diagnoses

    settings = diagnoses.Settings(
        source=_source(
            log, robot, table, unit, column, drive, servo, hold, fix_base, gravity_compensation
        ),
        out=out,
        healthy=tuple(healthy or ()),
        nominal=nominal,
        known_effects=known_effects,
    )
    failing = _failing(fail_on)
    result, summary = diagnoses.run(settings, force)
    if failing:
        result["ok"] = not failing & {_kind(result["verdict"])}
    return result, summary


@command(defaults={"out": "checks/LOG", **OF_FILES})
def check(
    log: LogFolder = None,
    robot: Robot = None,
    table: Table = None,
    unit: Unit = None,
    column: Column = None,
    drive: DriveOf = None,
    servo: ServoOf = None,
    hold: Hold = None,
    fix_base: FixBase = False,
    gravity_compensation: GravityCompensation = False,
    out: Out = None,
    force: Force = False,
) -> Any:
    """Read a log, say what was understood of it and draw it, before anything is fitted.

    Of two files it writes the log, whose log.yaml can be edited. Exits with 1 where the data has a
    fault.

    Example: [bold]bench check --robot arm.xml --log run.csv[/bold]
    """
    from benchmark.gap import check as checks

    source = _source(
        log, robot, table, unit, column, drive, servo, hold, fix_base, gravity_compensation
    )
    return checks.run(source, out, force)


def _source(
    log: Path | None,
    robot: Path | None,
    table: Path | None,
    unit: str | None,
    column: list[str] | None,
    drive: list[str] | None,
    servo: list[str] | None,
    hold: list[str] | None,
    fix_base: bool,
    gravity_compensation: bool,
) -> Any:
    """Where the log comes from."""
    from benchmark.gap.robot_log import Source

    return Source(
        folder=log,
        robot=robot,
        table=table,
        unit=unit,
        columns=column or (),
        drives=drive or (),
        servos=servo or (),
        hold=hold or (),
        fix_base=fix_base,
        gravity_compensation=gravity_compensation,
    )


def _failing(text: str | None) -> set[str]:
    """The kinds of verdict that fail a command; raises UsageError."""
    kinds = {word.strip() for word in (text or "").split(",") if word.strip()}
    if not kinds <= {CAUSE, UNKNOWN}:
        raise UsageError(f"--fail-on is '{text}'; allowed: {CAUSE}, {UNKNOWN}, or both")
    return kinds


def _kind(verdict: list[str]) -> str:
    return verdict[0] if verdict in (["none"], [UNKNOWN]) else CAUSE
