"""`bench calibrate` and `diagnose`: what a log says of the nominal world."""

from pathlib import Path
from typing import Annotated, Any

from benchmark.cli.command import command
from benchmark.cli.options import Force, Out, Seed, Workers
from benchmark.errors import UsageError
from benchmark.gap.asked import Calibration, Diagnosis, Source
from benchmark.settings.kinds import File, Setting, Text

CAUSE, UNKNOWN = "cause", "unknown"
TABLES = ("static", "locked", "moved")
"""Options that name a table in the place of a log."""


@command(defaults={"out": "calibrations/LOG"})
def calibrate(
    asked: Calibration,
    seed: Seed = 0,
    out: Out = None,
    force: Force = False,
    workers: Workers = None,
) -> Any:
    """Calibrate the nominal world to a log: gains by replays, play by the push test, and the skin.

    Writes calibration.yaml, which `bench run --calibration` takes, and a picture per joint.

    Example: [bold]bench calibrate logs/one --out calibrations/one[/bold]
    """
    from benchmark.gap import calibrate as calibrations

    return calibrations.run(asked, seed, out, force, workers)


@command(defaults={"out": "diagnoses/LOG", "fail_on": "nothing", **dict.fromkeys(TABLES, "none")})
def diagnose(
    asked: Diagnosis,
    static: Annotated[
        Path | None,
        Setting(
            kind=File("TABLE"),
            help="Instead of a log: targets and readings at rest, and loads where known.",
        ),
    ] = None,
    locked: Annotated[
        Path | None,
        Setting(
            kind=File("TABLE"),
            help="Instead of a log: torque and position while the output is locked.",
        ),
    ] = None,
    moved: Annotated[
        Path | None,
        Setting(
            kind=File("TABLE"),
            help="Instead of a log: torque and position while the joint is moved slowly.",
        ),
    ] = None,
    fail_on: Annotated[
        str | None,
        Setting(
            kind=Text("VERDICTS"),
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

    A few rows at rest: [bold]bench diagnose --robot arm.xml --static rests.csv[/bold]

    A gear with its output locked: [bold]bench diagnose --locked presses.csv[/bold]
    """
    from benchmark.gap import diagnose as diagnoses

    given = dict(zip(TABLES, (static, locked, moved), strict=True))
    tables_given = {kind: table for kind, table in given.items() if table is not None}
    if len(tables_given) > 1:
        raise UsageError(f"give one of {', '.join(f'--{kind}' for kind in tables_given)}")
    for kind, table in tables_given.items():
        from benchmark.gap import tables

        return tables.run(asked, kind, table)
    failing = _failing(fail_on)
    result, summary = diagnoses.run(asked, out, force)
    if failing:
        result["ok"] = not failing & {_kind(result["verdict"])}
    return result, summary


@command(defaults={"out": "checks/LOG"})
def check(
    source: Source,
    out: Out = None,
    force: Force = False,
) -> Any:
    """Read a log, say what was understood of it and draw it, before anything is fitted.

    Of two files it writes the log, whose log.yaml can be edited. Exits with 1 where the data has a
    fault.

    Example: [bold]bench check --robot arm.xml --log run.csv[/bold]
    """
    from benchmark.gap import check as checks

    return checks.run(source, out, force)


def _failing(text: str | None) -> set[str]:
    """The kinds of verdict that fail a command; raises UsageError."""
    kinds = {word.strip() for word in (text or "").split(",") if word.strip()}
    if not kinds <= {CAUSE, UNKNOWN}:
        raise UsageError(f"--fail-on is '{text}'; allowed: {CAUSE}, {UNKNOWN}, or both")
    return kinds


def _kind(verdict: list[str]) -> str:
    return verdict[0] if verdict in (["none"], [UNKNOWN]) else CAUSE
