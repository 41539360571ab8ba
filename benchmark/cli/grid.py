"""`bench sweep`, `transfer` and `leaderboard`: many runs, and what they say."""

from pathlib import Path
from typing import Annotated, Any

from benchmark.cli.command import command
from benchmark.cli.options import (
    FILE,
    Backends,
    DryRun,
    IncludeSmoke,
    Made,
    Out,
    Runs,
    Workers,
)
from benchmark.settings.kinds import File, Number, Setting, Switch, Text
from leaderboard.identity import EPISODES

GOES_ON = "what was written is kept; the same command goes on"


@command(defaults={"out": "runs", "partition": "the file's"}, kept=GOES_ON)
def sweep(
    file: Annotated[
        Path,
        Setting(kind=FILE, help="The grid, as YAML; see docs/guide/sweep.md.", argument=True),
    ],
    out: Out = None,
    slurm: Annotated[
        bool, Setting(kind=Switch(), help="Submit the cells to a Slurm cluster and wait.")
    ] = False,
    partition: Annotated[
        str | None, Setting(kind=Text("NAME"), help="Partition of the cluster.")
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
        "out": "transfer",
    },
    kept=GOES_ON,
)
def transfer(
    runs: Runs,
    backend: Backends = "all",
    effects: Annotated[
        tuple[str, ...],
        Setting(
            kind=Text("SET"),
            help="Effects to deploy with; repeatable, one set each time.",
            many=True,
        ),
    ] = ("built", "none"),
    setting: Annotated[
        tuple[str, ...],
        Setting(
            kind=Text("SETTINGS"),
            help="Deploy in these, too, such as radius=3cm or task=eight,pace=0.5; repeatable.",
            many=True,
        ),
    ] = (),
    episodes: Annotated[
        int,
        Setting(kind=Number(2, 10_000, whole=True), help="Episodes, the first of a fixed list."),
    ] = EPISODES,
    explain: Annotated[
        bool,
        Setting(
            kind=Switch(),
            help="Say which difference of two worlds makes each loss of a matrix, given as RUN.",
        ),
    ] = False,
    include_smoke: IncludeSmoke = False,
    out: Made = None,
    workers: Workers = None,
) -> Any:
    """Evaluate policies in other worlds: train x deploy matrix, retention, rank agreement.

    --backend mujoco@3.6.0 is another version of an engine, in an environment of its own.

    --explain takes a folder that this command wrote, and deploys its policies again with one
    difference of two worlds switched at a time; give their folders, too, if they were moved.

    Example: [bold]bench transfer runs --backend mujoco,bullet --out transfer[/bold]
    """
    from benchmark.results import transfer as transfers

    if explain:
        from benchmark.results.explain import explain as causes

        return causes(runs, out or Path("causes"), episodes, include_smoke, workers)
    return transfers.transfer(
        runs,
        backend,
        effects,
        setting,
        out or Path("transfer"),
        episodes,
        include_smoke,
        workers,
    )


@command(defaults={"sources": "runs, or the kept rows", "out": "leaderboard"})
def leaderboard(
    sources: Annotated[
        tuple[Path, ...],
        Setting(
            kind=File("RUN"),
            help="Run folders, folders of them, or JSON rows.",
            argument=True,
            many=True,
        ),
    ] = (),
    add: Annotated[
        bool, Setting(kind=Switch(), help="Copy the rows into OUT/results, to keep them.")
    ] = False,
    policies: Annotated[
        bool,
        Setting(kind=Switch(), help="Copy policies with a model card each to OUT/policies."),
    ] = False,
    html: Annotated[
        bool,
        Setting(kind=Switch(), help="Write leaderboard.html, too; it shows OUT/figures/*.png."),
    ] = True,
    include_smoke: IncludeSmoke = False,
    out: Made = None,
) -> Any:
    """Write leaderboard.csv, .md and .html from run folders or kept result rows.

    Example: [bold]bench leaderboard runs --out leaderboard[/bold]
    """
    from benchmark.results import leaderboard as boards

    return boards.leaderboard(sources, out, add, policies, html, include_smoke)
