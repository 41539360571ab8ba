"""The options of `bench blind make`, `run` and `score`."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import Json
from benchmark.console import emit

app = typer.Typer(
    help="Test the diagnosis blind: hidden cases, sealed answers, a score.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the set.")]
Answers = Annotated[
    Path, typer.Option(help="File of the sealed answers, outside the set's folder.")
]
Real = Annotated[
    str,
    typer.Option(
        help="What is real: some of mujoco,bullet,sapien,plant, all of these, or some of "
        "dart,bristle,drake,exudyn."
    ),
]
Rig = Annotated[str, typer.Option(help="all in free air, some of finger,hand,joint, or held.")]
Effects = Annotated[
    str, typer.Option(help="Some effects, or all that the rig is for: free air, or held stick.")
]
Protocols = Annotated[
    str, typer.Option(help="all, or some of steps,triangle,multisine,push, if held grasp,pull.")
]
Jobs = Annotated[
    int, typer.Option("--jobs", "-j", help="Cases at a time, one core each.", min=1, max=256)
]


@app.command()
def make(
    out: Annotated[Path, typer.Option(help="Folder to write the set to; must be new.")],
    answers: Answers,
    cases: Annotated[int, typer.Option(help="Number of cases, 1 to 999.")] = 40,
    real: Real = "all",
    rig: Rig = "finger",
    modes: Annotated[str, typer.Option(help="all, or some of single,pair,none,unknown.")] = "all",
    effects: Effects = "all",
    protocols: Protocols = "all",
    healthy: Annotated[
        int,
        typer.Option(
            help="Logs of sound mechanisms of the same make that the solver is given, 0 to 20."
        ),
    ] = 0,
    seed: Annotated[
        int | None, typer.Option(help="Decides every draw; a small one can be guessed. (secret)")
    ] = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Draw hidden cases: logs for the solver, and answers under a hash that is published first.

    Example: [bold]bench blind make --out blind/a --answers sealed/a.json --cases 100[/bold]
    """
    from benchmark import blind

    wanted = blind.settings(cases, real, rig, modes, effects, protocols, healthy=healthy)
    emit(blind.make(wanted, seed, out, answers, jobs), as_json)


@app.command()
def run(
    folder: Folder,
    jobs: Jobs = 1,
    anyway: Annotated[
        bool,
        typer.Option("--anyway", help="Solve although rules or code changed since the draw."),
    ] = False,
    rival: Annotated[
        str | None,
        typer.Option(help="Ask another method instead, for a line of the score: mujoco-sysid."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Diagnose every case from its log alone; cases that this solver has solved are skipped.

    Example: [bold]bench blind run blind/a -j 2[/bold]
    """
    from benchmark import blind

    if rival is None:
        result = blind.run(folder, jobs, anyway)
    else:
        result = blind.run_rival(folder, rival, jobs)
    emit(result, as_json)


@app.command()
def detectable(
    out: Annotated[Path, typer.Option(help="Folder for detectable.csv and detectable.md.")],
    real: Real = "mujoco,plant",
    rig: Rig = "joint",
    effects: Effects = "all",
    protocols: Protocols = "all",
    draws: Annotated[
        int, typer.Option(help="Nominal errors and motions; half of them must show.", min=1)
    ] = 4,
    seed: Annotated[int, typer.Option(help="Decides every draw.")] = 0,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Search the smallest magnitude of every effect that shows, each protocol by itself.

    What taxels, stick and contact show in a grasp: [bold]--rig held --real mujoco[/bold].

    Example: [bold]bench blind detectable --out detectable --effects backlash[/bold]
    """
    from benchmark import blind

    wanted = blind.settings(1, real, rig, "single", effects, protocols, 1)
    result, table = blind.detectable(wanted, draws, seed, out, jobs)
    emit(result, as_json, table)


@app.command()
def score(
    folder: Folder,
    answers: Answers,
    out: Annotated[
        Path | None, typer.Option(help="Folder for score.md, score.json and the tables as CSV.")
    ] = None,
    jobs: Jobs = 1,
    as_json: Json = False,
) -> None:
    """Check the answers against their hash, open them and score the results.

    Example: [bold]bench blind score blind/a --answers sealed/a.json --out scores/a[/bold]
    """
    from benchmark import blind

    result, table = blind.score(folder, answers, out, jobs)
    emit(result, as_json, table)
