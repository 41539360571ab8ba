"""`bench sweep`, `transfer` and `leaderboard`: many runs, and what they say."""

from pathlib import Path
from typing import Annotated, Any

import typer

from benchmark.cli.command import command
from benchmark.cli.options import (
    Backends,
    DryRun,
    Episodes,
    IncludeSmoke,
    Made,
    Out,
    Runs,
    Workers,
)

GOES_ON = "what was written is kept; the same command goes on"


@command(defaults={"out": "runs", "partition": "the file's"}, kept=GOES_ON)
def sweep(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="The grid, as YAML; see docs/guide/sweep.md.")
    ],
    out: Out = None,
    slurm: Annotated[
        bool, typer.Option("--slurm", help="Submit the cells to a Slurm cluster and wait.")
    ] = False,
    partition: Annotated[
        str | None, typer.Option(metavar="NAME", help="Partition of the cluster.")
    ] = None,
    dry_run: DryRun = False,
    workers: Workers = None,
) -> Any:
    """Run every cell of a grid that is not finished yet, one core each.

    A cell that fails leaves the others alone.

    Example: [bold]bench sweep sweeps/smoke.yaml -j 2[/bold]
    """
    from benchmark.sweep import sweep as sweeps

    if dry_run:
        return sweeps.preview(file, out, workers)
    return sweeps.sweep(file, out, workers, slurm, partition)


@command(
    defaults={
        "effects": "built and none, each alone",
        "setting": "the policies' own",
        "episodes": "100",
        "out": "transfer",
    },
    kept=GOES_ON,
)
def transfer(
    runs: Runs,
    backend: Backends = "all",
    effects: Annotated[
        list[str] | None,
        typer.Option(metavar="SET", help="Effects to deploy with; repeatable, one set each time."),
    ] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SETTINGS",
            help="Deploy in these, too, such as radius=3cm or task=eight,pace=0.5; repeatable.",
        ),
    ] = None,
    episodes: Episodes = None,
    include_smoke: IncludeSmoke = False,
    out: Made = None,
    workers: Workers = None,
) -> Any:
    """Evaluate policies in other worlds: train x deploy matrix, retention, rank agreement.

    --backend mujoco@3.6.0 is another version of an engine, in an environment of its own.

    Example: [bold]bench transfer runs --backend mujoco,bullet --out transfer[/bold]
    """
    from benchmark.results import transfer as transfers
    from leaderboard.identity import EPISODES

    return transfers.transfer(
        runs,
        backend,
        effects or ["built", "none"],
        setting or [],
        out or Path("transfer"),
        EPISODES if episodes is None else episodes,
        include_smoke,
        workers,
    )


@command(defaults={"sources": "runs, or the kept rows", "out": "leaderboard"})
def leaderboard(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RUN", help="Run folders, folders of them, or JSON rows."),
    ] = None,
    add: Annotated[
        bool, typer.Option("--add", help="Copy the rows into OUT/results, to keep them.")
    ] = False,
    policies: Annotated[
        bool,
        typer.Option("--policies", help="Copy policies with a model card each to OUT/policies."),
    ] = False,
    html: Annotated[
        bool, typer.Option(help="Write leaderboard.html, too; it shows OUT/figures/*.png.")
    ] = True,
    include_smoke: IncludeSmoke = False,
    out: Made = None,
) -> Any:
    """Write leaderboard.csv, .md and .html from run folders or kept result rows.

    Example: [bold]bench leaderboard runs --out leaderboard[/bold]
    """
    from benchmark.results import leaderboard as boards

    return boards.leaderboard(sources or [], out, add, policies, html, include_smoke)
