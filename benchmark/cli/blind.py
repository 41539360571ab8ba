"""`bench blind make`, `run`, `score` and more: the diagnosis tested on hidden effects."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmark.cli.command import command
from benchmark.cli.options import (
    COUNT,
    DIR,
    FILE,
    Cases,
    HiddenEffects,
    NewFolder,
    Out,
    OutFile,
    Protocol,
    Real,
    Rig,
    Seed,
    Workers,
)
from benchmark.errors import UsageError
from benchmark.settings.kinds import Number, Setting, Span, Switch, Text

Folder = Annotated[Path, Setting(kind=DIR, help="Folder of the set.", argument=True)]
Answers = Annotated[
    Path, Setting(kind=FILE, help="File of the sealed answers, outside the set's folder.")
]
Folders = Annotated[
    tuple[Path, ...], Setting(kind=DIR, help="Folders of solved sets.", argument=True, many=True)
]
AnswersOfEach = Annotated[
    tuple[Path, ...],
    Setting(kind=FILE, help="Answers of each set, in the same order; repeatable.", many=True),
]

app = typer.Typer(
    help="Test the diagnosis blind: hidden cases, sealed answers, a score.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)
HELP = {"help_option_names": ["-h", "--help"]}


@app.command(context_settings=HELP)
@command(defaults={"seed": "secret; a small one can be guessed"})
def make(
    out: NewFolder,
    answers: Answers,
    cases: Cases = 40,
    real: Real = "all",
    rig: Rig = "finger",
    modes: Annotated[
        str, Setting(kind=Text("NAMES"), help="all, or some of single, pair, none, unknown.")
    ] = "all",
    hidden_effects: HiddenEffects = "all",
    protocol: Protocol = "all",
    healthy_logs: Annotated[
        int,
        Setting(
            help="Healthy logs per plant that the solver gets.", kind=Number(0, 20, whole=True)
        ),
    ] = 0,
    times: Annotated[
        tuple[float, float],
        Setting(
            kind=Span(),
            help="Of drawn arms: how many times what the robot leaves by itself its fault leaves.",
        ),
    ] = (3.0, 30.0),
    seed: Annotated[
        int | None,
        Setting(kind=Number(0, whole=True), help="Decides every random draw."),
    ] = None,
    workers: Workers = None,
) -> Any:
    """Draw hidden cases: logs for the solver, and answers under a hash that is published first.

    Example: [bold]bench blind make --out blind/a --answers sealed/a.json --cases 100[/bold]
    """
    from benchmark.gap import blind

    wanted = blind.settings(
        cases,
        real,
        rig,
        modes,
        hidden_effects,
        protocol,
        healthy=healthy_logs,
        times=times,
    )
    return blind.make(wanted, seed, out, answers, workers)


@app.command(context_settings=HELP)
@command(kept="solved cases are kept; the same command goes on")
def run(
    folder: Folder,
    anyway: Annotated[
        bool,
        Setting(kind=Switch(), help="Solve although the solver changed since the commitment."),
    ] = False,
    workers: Workers = None,
) -> Any:
    """Diagnose every case from its log alone; cases that this solver has solved are skipped.

    Example: [bold]bench blind run blind/a -j 2[/bold]
    """
    from benchmark.gap import blind

    return blind.run(folder, workers, anyway)


@app.command(context_settings=HELP)
@command()
def commit(folder: Folder) -> Any:
    """Commit a set that nothing was solved on to the solver as it is now.

    Example: [bold]bench blind commit blind/a[/bold]
    """
    from benchmark.gap import blind

    return blind.commit(folder)


@app.command(context_settings=HELP)
@command()
def detectable(
    out: NewFolder,
    real: Real = "mujoco,plant",
    rig: Rig = "joint",
    hidden_effects: HiddenEffects = "all",
    protocol: Protocol = "all",
    draws: Annotated[
        int,
        Setting(kind=COUNT, help="Nominal errors and motions; half of them must show."),
    ] = 4,
    seed: Seed = 0,
    workers: Workers = None,
) -> Any:
    """Search the smallest magnitude of every effect that shows, each protocol by itself.

    What taxels, stick and contact show in a grasp: [bold]--rig held --real mujoco[/bold].

    Example: [bold]bench blind detectable --out detectable --hidden-effects backlash[/bold]
    """
    from benchmark.gap import blind

    wanted = blind.settings(1, real, rig, "single", hidden_effects, protocol, 1)
    return blind.detectable(wanted, draws, seed, out, workers)


@app.command(context_settings=HELP)
@command(defaults={"out": "none"})
def score(
    folders: Folders,
    answers: AnswersOfEach,
    out: Out = None,
    replay: Annotated[
        int,
        Setting(
            kind=Number(0, whole=True),
            help="Solve so many cases of each at random again, and compare.",
        ),
    ] = 0,
    workers: Workers = None,
) -> Any:
    """Check the answers against their hash, open them and score the results, sets together.

    Results of other logs than the committed ones are refused. With --out, writes score.md,
    score.json and the tables as CSV.

    Example: [bold]bench blind score blind/a --answers sealed/a.json --out blind/a-score[/bold]
    """
    from benchmark.gap import blind

    return blind.score(_pairs(folders, answers), out, workers, replay)


def _pairs(folders: Sequence[Path], answers: Sequence[Path]) -> list[tuple[Path, Path]]:
    if len(folders) != len(answers):
        raise UsageError(
            f"{len(folders)} sets and {len(answers)} --answers; give one for each, in order"
        )
    return list(zip(folders, answers, strict=True))


@app.command(context_settings=HELP)
@command(kept="what is drawn and solved is kept; the same command goes on")
def judge(
    out: NewFolder,
    sets: Annotated[
        tuple[str, ...],
        Setting(kind=Text("SET"), help="Names of sets; all by default.", argument=True, many=True),
    ] = (),
    stages: Annotated[
        str, Setting(kind=Text("NAMES"), help="Some of draw,solve,score.")
    ] = "draw,solve,score",
    workers: Workers = None,
) -> Any:
    """Draw, solve and score the sets of the repository that a solver is judged on.

    Answers go to the folder sealed, scores to the folder scores beside the sets.

    Example: [bold]bench blind judge makes-1 --out judged -j 2[/bold]
    """
    from benchmark.gap import blind_sets

    return blind_sets.judge(sets, out, [s.strip() for s in stages.split(",")], workers)


@app.command(context_settings=HELP)
@command()
def calibrate(
    folders: Folders,
    answers: AnswersOfEach,
    out: OutFile,
) -> Any:
    """Fit the curve of confidence to solved sets, and test it on each real side by the others.

    Example: [bold]bench blind calibrate blind/a --answers sealed/a.json --out curve.json[/bold]
    """
    from benchmark.gap import blind

    return blind.calibrate(_pairs(folders, answers), out)
