"""The options of `bench sweep`, `transfer` and `leaderboard`: many runs, and what they say."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import Json, Out, Workers
from benchmark.console import emit


def sweep(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.yaml", help="The grid; see docs/sweeps.md.")
    ],
    out: Out = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", help="Cells at a time, one core each. (all cores)", min=1),
    ] = None,
    slurm: Annotated[
        bool, typer.Option("--slurm", help="Submit the cells to a Slurm cluster and wait.")
    ] = False,
    partition: Annotated[
        str | None, typer.Option(help="Partition of the cluster. (the file's)")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Name the cells and the time they will take.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run every cell of a grid that is not finished yet; a cell that fails leaves the others alone.

    Example: [bold]bench sweep sweeps/smoke.yaml -j 2[/bold]
    """
    from benchmark import sweep as sweeps

    if dry_run:
        plan, table = sweeps.preview(file, out, jobs)
        emit(plan, as_json, table)
        return
    result, table = sweeps.sweep(file, out, jobs, slurm, partition)
    emit(result, as_json, table)
    if result["status"] != "done":
        raise typer.Exit(1)


def transfer(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Finished runs, or folders of them.")
    ],
    out: Annotated[Path, typer.Option(help="Folder to write to; what it holds is not redone.")],
    deploy: Annotated[
        str, typer.Option(help="Engines to deploy in, between commas.")
    ] = "mujoco,bullet,sapien",
    effects: Annotated[
        list[str] | None,
        typer.Option(help="Effects to deploy with; give it once per set. (built,none: each alone)"),
    ] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option(help="Deploy in these too, such as radius=3cm or task=eight,speed=0.5."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Episodes per policy and world, 2 to 10000.")] = 100,
    smoke_too: Annotated[
        bool, typer.Option("--smoke-too", help="Take smoke runs as well.")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Evaluate policies in other worlds: train x deploy matrix, retention, rank agreement.

    Example: [bold]bench transfer runs --deploy mujoco,bullet --out transfer[/bold]
    """
    from benchmark import transfer as transfers

    sets, settings = effects or ["built,none"], setting or []
    result, table = transfers.transfer(
        runs, deploy, sets, settings, out, episodes, smoke_too, workers
    )
    emit(result, as_json, table)
    if result["status"] != "done":
        raise typer.Exit(1)


def leaderboard(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUNS]...", help="Run folders, folders of them, or JSON rows."),
    ] = None,
    out: Out = None,
    add: Annotated[
        bool, typer.Option("--add", help="Copy the rows into OUT/results, to keep them.")
    ] = False,
    policies: Annotated[
        bool,
        typer.Option("--policies", help="Copy policies with a model card each to OUT/policies."),
    ] = False,
    html: Annotated[
        bool, typer.Option(help="Write leaderboard.html too; it shows OUT/figures/*.png.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Write leaderboard.csv, .md and .html from run folders or kept result rows.

    Example: [bold]bench leaderboard runs --out leaderboard[/bold]
    """
    from benchmark import commands

    emit(commands.leaderboard(sources or [], out, add, policies, html), as_json)
