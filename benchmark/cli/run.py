"""`bench run`, `eval` and `view`: one policy at a time."""

from pathlib import Path
from typing import Annotated, Any

from rich.console import Group
from rich.table import Table
from rich.text import Text as Line

from backends.spec import Timing
from benchmark.cli.command import OF_RUN, command
from benchmark.cli.options import (
    DIR,
    FILE,
    DryRun,
    Episodes,
    Force,
    Made,
    Out,
    Resume,
    Run,
    Workers,
)
from benchmark.console import listed, row_table
from benchmark.errors import UsageError
from benchmark.settings.kinds import Choice, File, Number, Setting, Switch, Text
from benchmark.settings.run_spec import DEPLOYED, SETTINGS, RunSpec, read_settings
from tasks.task import EPISODE_S

LOG_FILE = "log.yaml"
"""A folder that has one is a log."""
SHOWN = ["status", "backend", "task", "algo", "effects", "p_err_cm", "q_err_deg", "held", "tracked"]
SHOWN += ["steps", "wall_s", "env_steps_per_s"]


@command(
    tuple(SETTINGS),
    required=("backend", "task"),
    defaults={
        "out": "runs/NAME",
        "calibration": "none",
        "config": "none",
        "start": "none",
        "logger": "none",
    },
    kept="what was written is kept; --resume continues",
)
def run(
    settings: dict[str, Any],
    calibration: Annotated[
        Path | None,
        Setting(kind=FILE, help="A calibration.yaml: its world and its spread."),
    ] = None,
    overrides: Annotated[
        tuple[str, ...],
        Setting(
            name="set",
            kind=Text("KEY=VALUE"),
            help="A hyperparameter of the learner, such as lr=3e-4; repeatable.",
            many=True,
        ),
    ] = (),
    config: Annotated[
        Path | None,
        Setting(kind=FILE, help="Settings to begin with: a run's run.json, or YAML as in a sweep."),
    ] = None,
    start: Annotated[
        Path | None,
        Setting(
            name="from",
            kind=File("RUN"),
            help="Run whose policy training starts from (fine-tuning).",
        ),
    ] = None,
    out: Out = None,
    resume: Resume = False,
    force: Force = False,
    dry_run: DryRun = False,
    logger: Annotated[
        str | None,
        Setting(
            kind=Choice("logger", ("tensorboard",)),
            help="Log the training in RUN/tensorboard, too.",
        ),
    ] = None,
    workers: Workers = None,
) -> Any:
    """Train a policy, evaluate 100 fixed episodes, write the run folder, print the row.

    Example: [bold]bench run --backend bullet --task eight[/bold]
    """
    from benchmark.runs.run import row_of_run
    from benchmark.settings.request import read_pairs, requested

    asked = requested(settings, calibration, read_pairs(overrides), config, start)
    if dry_run:
        from benchmark.runs.plan import plan

        planned = plan(asked, out, workers)
        return planned, _planned(asked, planned)
    row = row_of_run(asked, out, workers, resume, force, start, logger)
    said = [f"folder: {row['dir']}"]
    said += [f"see the training: tensorboard --logdir {row['dir']}"] if logger else []
    return row, Group(row_table(row, SHOWN), *said)


def _planned(asked: RunSpec, plan: dict[str, Any]) -> Table:
    """A planned run, its settings as they are typed."""
    shown = {one.name: one.kind.show(getattr(asked, one.field)) for one in SETTINGS.values()}
    rest = {name: value for name, value in plan.items() if name != "would_run"}
    return listed({**shown, "set": dict(asked.overrides), **rest})


@command(DEPLOYED, default=OF_RUN, defaults={"episodes": "100", "out": "none is written"})
def evaluate(
    run_folder: Run,
    settings: dict[str, Any],
    episodes: Episodes = None,
    out: Made = None,
    workers: Workers = None,
) -> Any:
    """Evaluate a saved policy in any world, task setting and stick.

    Example: [bold]bench eval runs/NAME --backend mujoco --radius 3cm --pace 1.5[/bold]
    """
    from benchmark.runs.evaluate import evaluate_policy

    row = evaluate_policy(run_folder, settings, episodes, out, workers)
    kept = " and ".join(row["written"]) or "nothing; --out FOLDER keeps the row and its episodes"
    return row, Group(row_table(row, SHOWN[:9]), Line(f"Wrote {kept}."))


@command(
    DEPLOYED,
    default=OF_RUN,
    defaults={
        "kind": "figure; hand for a video",
        "episodes": "10 for figure, else 1",
        "time": "2s",
        "diagnosis": "diagnoses/LOG",
    },
)
def view(
    run_folders: Annotated[
        tuple[Path, ...],
        Setting(
            kind=File("RUN"),
            help="Folder of a run; curve takes several.",
            argument=True,
            many=True,
        ),
    ],
    settings: dict[str, Any],
    out: Annotated[Path | None, Setting(kind=FILE, help="File to write.")] = None,
    live: Annotated[
        bool,
        Setting(
            kind=Switch(),
            help="Show the run in the browser instead, until Ctrl-C; or the folder of a log: the "
            "robot as measured, nominal and corrected.",
        ),
    ] = False,
    diagnosis: Annotated[
        Path | None,
        Setting(kind=DIR, help="What `bench diagnose` wrote of the log."),
    ] = None,
    port: Annotated[
        int, Setting(kind=Number(0, 65535, whole=True), help="Where --live serves.")
    ] = 8080,
    kind: Annotated[
        str | None,
        Setting(
            kind=Text("NAME"),
            help="figure: drawn paths; joints: targets and positions over a lap; touch: contact "
            "positions and taxels; hand: the grasp; curve: learning.",
        ),
    ] = None,
    episodes: Episodes = None,
    time: Annotated[
        float | None,
        Setting(
            kind=Number(Timing.policy_s, EPISODE_S, "s"),
            help="Moment of episode 0 that hand shows.",
        ),
    ] = None,
    workers: Workers = None,
) -> Any:
    """Draw a run: the paper's figures, the hand at a moment, a video or learning curves.

    What is drawn follows from --kind and from the file's ending: .png, or .mp4 and .gif for videos.

    Example: [bold]bench view runs/NAME --out video.mp4[/bold]
    """
    from benchmark.pictures.view import view, view_live, view_log

    changed = read_settings(settings)
    if live:
        if len(run_folders) > 1 or out is not None:
            raise UsageError("--live shows one run or log and writes no file; leave --out out")
        if (run_folders[0] / LOG_FILE).exists():
            return view_log(run_folders[0], diagnosis, port)
        return view_live(run_folders[0], changed, port, workers)
    if out is None:
        raise UsageError("where to? give --out FILE, or --live for the browser")
    return view(run_folders, out, kind, changed, episodes, time, workers)
