"""The `bench` command: what it takes, and what it exits with.

Nothing heavy is imported up here: `bench --help` and `bench list` load no engine and no learner.
"""

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from benchmark import errors
from benchmark.console import ERR, divert_stdout, emit, row_table

app = typer.Typer(
    name="bench",
    help="Stickbench: one tactile hand, one stick, the same tasks in every physics engine.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

Backend = Annotated[str, typer.Option(help="Physics engine: mujoco, bullet or sapien.")]
TaskName = Annotated[str, typer.Option(help="Figure to draw: line, circle, spiral or eight.")]
Radius = Annotated[str | None, typer.Option(help="Size of the figure, such as 3cm. (2cm)")]
Speed = Annotated[float | None, typer.Option(help="Pace over the training pace, such as 1.5. (1)")]
Stick = Annotated[str | None, typer.Option(help="Stick to hold; `bench list` names them.")]
Effects = Annotated[
    str | None,
    typer.Option(help="'built', 'none', or such as backlash=1.2deg,kp-scale=-10%@J3. (built)"),
]
Workers = Annotated[
    int | None, typer.Option(help="Cores to simulate on; changes no result. (all)", min=1)
]
Out = Annotated[Path | None, typer.Option(help="Folder to write to.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Seed = Annotated[int, typer.Option(help="Decides every random draw of the training.")]

INTERRUPTED = 130
"""Exit code after Ctrl-C; typer gives it back as a command's result."""
SHOWN = ["status", "backend", "task", "algo", "effects", "p_err_cm", "q_err_deg", "held", "tracked"]
SHOWN += ["steps", "wall_s", "env_steps_per_s", "dir"]


@app.command()
def run(
    backend: Backend,
    task: TaskName,
    observation: Annotated[str, typer.Option(help="What the policy sees.")] = "contact-centers",
    algo: Annotated[str, typer.Option(help="sb3-ppo, rsl-ppo, hold-still or random.")] = "sb3-ppo",
    stick: Stick = None,
    effects: Effects = None,
    radius: Radius = None,
    speed: Speed = None,
    steps: Annotated[
        str | None, typer.Option(help="Training budget in environment steps, such as 2e6.")
    ] = None,
    seed: Seed = 0,
    randomize: Annotated[
        bool, typer.Option(help="Train on worlds drawn around the nominal one.")
    ] = True,
    smoke: Annotated[
        bool, typer.Option("--smoke", help="Walk the whole path in under a minute; never ranked.")
    ] = False,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue a killed run.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")] = False,
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
        radius=radius,
        speed=speed,
        steps=steps,
        seed=seed,
        randomize=randomize,
        smoke=smoke,
    )
    if dry_run:
        emit(commands.plan(settings, out, workers), as_json)
        return
    row = commands.run(settings, out, workers, resume, force)
    emit(row, as_json, row_table(row, SHOWN))


@app.command("eval")
def evaluate(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
    backend: Annotated[str | None, typer.Option(help="Engine to deploy in. (the run's)")] = None,
    task: Annotated[str | None, typer.Option(help="Figure to draw. (the run's)")] = None,
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


@app.command()
def view(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
    out: Annotated[Path, typer.Option(help="Picture to write, such as view.png.")],
    kind: Annotated[
        str, typer.Option(help="figure: the drawn paths; hand: the grasp at one moment.")
    ] = "figure",
    episodes: Annotated[int, typer.Option(help="Fixed episodes to replay, 1 to 100.")] = 10,
    time: Annotated[
        float | None, typer.Option(help="Second of episode 0 that `hand` shows, 0.02 to 6. (2)")
    ] = None,
    backend: Annotated[
        str | None, typer.Option(help="Engine to replay in, if not the run's.")
    ] = None,
    effects: Effects = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Replay a run's policy and draw it: the paths of the stick's lower end, or the hand.

    Example: [bold]bench view runs/NAME --kind hand --time 3 --out hand.png[/bold]
    """
    from benchmark import commands
    from benchmark.view import view

    changes = commands.changes(backend=backend, effects=effects)
    emit(view(run_folder, out, kind, changes, episodes, time, workers), as_json)


@app.command()
def leaderboard(
    sources: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUNS]...", help="Run folders, folders of them, or JSON rows."),
    ] = None,
    out: Out = None,
    add: Annotated[
        bool, typer.Option("--add", help="Copy the rows into OUT/results, to keep them.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write leaderboard.csv and leaderboard.md from run folders or kept result rows.

    Example: [bold]bench leaderboard runs --out leaderboard[/bold]
    """
    from benchmark import commands

    emit(commands.leaderboard(sources or [], out, add), as_json)


@app.command("list")
def list_parts(
    support: Annotated[
        bool, typer.Option("--support", help="What every engine makes of every number.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Name every backend, task, observation, algorithm, effect and stick.

    Example: [bold]bench list --support[/bold]
    """
    from benchmark import listing

    result, table = listing.support() if support else listing.parts()
    emit(result, as_json, table)


@app.command()
def doctor(as_json: Json = False) -> None:
    """Check every engine and learner: version, whether it works, and what would mend it.

    Example: [bold]bench doctor[/bold]
    """
    from benchmark.doctor import examine

    result, table = examine()
    emit(result, as_json, table)
    if not result["ok"]:
        raise typer.Exit(1)


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Entry point: run a command and turn every failure into one message and an exit code."""
    signal.signal(signal.SIGTERM, _stop)
    if "--help" not in sys.argv and len(sys.argv) > 1:
        divert_stdout()
    sys.exit(_run(sys.argv[1:]))


def _run(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    try:
        code = app(arguments, standalone_mode=False)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        return code if isinstance(code, int) else 0
    except errors.CommandError as error:
        return _fail(str(error), error.exit_code, as_json)
    except OSError as error:
        where = f" {error.filename}" if error.filename else ""
        return _fail(f"cannot use{where}: {error.strerror or error}", 1, as_json)
    except (KeyboardInterrupt, typer.Abort):
        kept = "interrupted; what was written is kept, --resume continues a run"
        return _fail(kept, INTERRUPTED, as_json)
    except typer.TyperException as error:
        return _fail(f"{error.format_message()} See `bench --help`.", 2, as_json)


def _fail(message: str, code: int, as_json: bool) -> int:
    ERR.print(f"bench: {message}", markup=False)
    if as_json:
        status = "interrupted" if code == INTERRUPTED else "error"
        emit({"status": status, "error": message}, True)
    return code
