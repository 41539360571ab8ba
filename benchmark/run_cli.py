"""The options of `bench run`, `eval` and `view`: one policy at a time."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import (
    Backend,
    Effects,
    Force,
    Json,
    Out,
    Radius,
    Seed,
    Speed,
    Stick,
    TaskName,
    Workers,
)
from benchmark.console import emit, row_table

OtherTask = Annotated[str | None, typer.Option(help="Figure to draw. (the run's)")]
SHOWN = ["status", "backend", "task", "algo", "effects", "p_err_cm", "q_err_deg", "held", "tracked"]
SHOWN += ["steps", "wall_s", "env_steps_per_s", "dir"]


def run(
    backend: Backend,
    task: TaskName,
    observation: Annotated[str, typer.Option(help="What the policy sees.")] = "contact-centers",
    algo: Annotated[str, typer.Option(help="sb3-ppo, rsl-ppo, hold-still or random.")] = "sb3-ppo",
    stick: Stick = None,
    effects: Effects = None,
    calibration: Annotated[
        Path | None,
        typer.Option(help="A calibration.yaml: its world and spread instead of --effects."),
    ] = None,
    radius: Radius = None,
    speed: Speed = None,
    steps: Annotated[
        str | None, typer.Option(help="Training budget in environment steps, such as 2e6.")
    ] = None,
    seed: Seed = 0,
    randomize: Annotated[
        bool, typer.Option(help="Train on worlds drawn around the nominal one.")
    ] = True,
    spread: Annotated[
        str | None,
        typer.Option(help="How far they are drawn: effects with their spreads. (the paper's)"),
    ] = None,
    start_spread: Annotated[
        float | None,
        typer.Option(help="Width of the drawn initial states, 0 (a single one) to 1. (1)"),
    ] = None,
    smoke: Annotated[
        bool, typer.Option("--smoke", help="Walk the whole path in under a minute; never ranked.")
    ] = False,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a killed run.")] = False,
    force: Force = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would be run and how long it takes.")
    ] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Train a policy, evaluate 100 fixed episodes, write the run folder, print the row.

    Example: [bold]bench run --backend bullet --task eight[/bold]
    """
    from benchmark import commands

    settings = commands.settings(
        backend=backend,
        task=task,
        observation=observation,
        algo=algo,
        stick=stick,
        effects=effects,
        calibration=calibration,
        radius=radius,
        speed=speed,
        steps=steps,
        seed=seed,
        randomize=randomize,
        spread=spread,
        start_spread=start_spread,
        smoke=smoke,
    )
    if dry_run:
        emit(commands.plan(settings, out, workers), as_json)
        return
    row = commands.run(settings, out, workers, resume, force)
    emit(row, as_json, row_table(row, SHOWN))


def evaluate(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
    backend: Annotated[str | None, typer.Option(help="Engine to deploy in. (the run's)")] = None,
    task: OtherTask = None,
    observation: Annotated[
        str | None, typer.Option(help="Must be the one it was trained on. (the run's)")
    ] = None,
    radius: Radius = None,
    speed: Speed = None,
    stick: Stick = None,
    effects: Effects = None,
    out: Out = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Evaluate a saved policy in any world, task setting and stick. Settings default to the run's.

    Example: [bold]bench eval runs/NAME --backend mujoco --radius 3cm --speed 1.5[/bold]
    """
    from benchmark import commands

    changes = commands.changes(
        backend=backend,
        task=task,
        observation=observation,
        radius=radius,
        speed=speed,
        stick=stick,
        effects=effects,
    )
    row = commands.evaluate(run_folder, changes, out, workers)
    emit(row, as_json, row_table(row, SHOWN[:9]))


def view(
    run_folders: Annotated[
        list[Path], typer.Argument(metavar="RUN", help="Folder of a run; curve takes several.")
    ],
    out: Annotated[Path, typer.Option(help="File to write: .png, or .mp4 or .gif for a video.")],
    kind: Annotated[
        str | None,
        typer.Option(
            help="figure: drawn paths; joints: targets and positions over a lap; touch: contact "
            "positions and taxels; hand: the grasp; curve: learning. (figure; hand for a video)"
        ),
    ] = None,
    episodes: Annotated[
        int | None, typer.Option(help="Fixed episodes to replay, 1 to 100. (figure 10, else 1)")
    ] = None,
    time: Annotated[
        float | None, typer.Option(help="Second of episode 0 that `hand` shows, 0.02 to 6. (2)")
    ] = None,
    backend: Annotated[
        str | None, typer.Option(help="Engine to replay in, if not the run's.")
    ] = None,
    task: OtherTask = None,
    radius: Radius = None,
    speed: Speed = None,
    stick: Stick = None,
    effects: Effects = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Draw a run: the paper's figures, the hand at a moment, a video, or learning curves.

    Example: [bold]bench view runs/NAME --out video.mp4[/bold]
    """
    from benchmark import commands
    from benchmark.view import view

    changes = commands.changes(
        backend=backend, task=task, radius=radius, speed=speed, stick=stick, effects=effects
    )
    emit(view(run_folders, out, kind, changes, episodes, time, workers), as_json)
