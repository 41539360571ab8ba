"""The `bench` command: what it takes, and what it exits with.

Nothing heavy is imported up here: `bench --help` and `bench list` load no engine and no learner.
"""

import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from benchmark import blind_cli, errors
from benchmark.console import ERR, divert_stdout, emit, row_table

app = typer.Typer(
    name="bench",
    help="Stickbench: one tactile hand, one stick, the same tasks in every physics engine.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.add_typer(blind_cli.app, name="blind")

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
    effects: Effects = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Draw a run: the paper's figures, the hand at a moment, a video, or learning curves.

    Example: [bold]bench view runs/NAME --out video.mp4[/bold]
    """
    from benchmark import commands
    from benchmark.view import view

    changes = commands.changes(backend=backend, effects=effects)
    emit(view(run_folders, out, kind, changes, episodes, time, workers), as_json)


@app.command()
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


@app.command()
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
        typer.Option(help="Deploy in these too, such as radius=3cm or speed=0.5,stick=fabric."),
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


@app.command()
def record(
    backend: Backend,
    out: Annotated[Path, typer.Option(help="Folder of the log; must not exist yet.")],
    protocol: Annotated[
        str,
        typer.Option(help="all, or some of steps,triangle,multisine,push,grasp,policy."),
    ] = "all",
    effects: Effects = None,
    known_effects: Annotated[
        str, typer.Option(help="Effects that the log names as known; all others it keeps secret.")
    ] = "none",
    stick: Stick = None,
    policy: Annotated[
        Path | None, typer.Option(help="Run folder of the policy that the protocol 'policy' plays.")
    ] = None,
    channels: Annotated[
        str,
        typer.Option(
            help="all, or some of motor,torque,velocity,push,touch,stick, or contact for touch as "
            "yes or no; command and position are always there."
        ),
    ] = "all",
    rate: Annotated[float, typer.Option(help="Samples per second.")] = 200.0,
    variants: Annotated[
        int, typer.Option(help="Episodes per protocol, each with other phases and grips.", min=1)
    ] = 1,
    repeats: Annotated[
        int, typer.Option(help="Times that each is repeated with other sensor noise.", min=1)
    ] = 1,
    seed: Annotated[int, typer.Option(help="Decides every phase, grip and noise.")] = 0,
    form: Annotated[str, typer.Option(help="Form of the samples: parquet or csv.")] = "parquet",
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Put an engine through the excitation protocols and write a log as a robot's would be.

    The log names hand and stick; the effects stand in its provenance.json, which nothing reads.

    Example: [bold]bench record --backend mujoco --effects backlash=1.5deg@J3 --out logs/one[/bold]
    """
    from benchmark import record as records

    world = records.world(backend, effects, known_effects, stick, policy, workers)
    plan = records.plan(world, protocol, channels, rate, variants, repeats, seed)
    emit(records.record(world, plan, out, form), as_json)


@app.command()
def excite(
    out: Annotated[Path, typer.Option(help="CSV file to write, such as commands.csv.")],
    protocol: Annotated[
        str, typer.Option(help="all, or some of steps,triangle,multisine,push.")
    ] = "all",
    joints: Annotated[
        str | None, typer.Option(help="Names of your joints between commas. (the TRX hand's)")
    ] = None,
    ranges: Annotated[
        str | None,
        typer.Option("--range", help="Where they may move: -60:60deg, 0:0.2m; one, or one each."),
    ] = None,
    limit: Annotated[
        float | None, typer.Option(help="Largest drive torque [Nm] or force [N]; for the push.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples per second, 20 to 1000.")] = 200.0,
    one_at_a_time: Annotated[
        bool, typer.Option("--one-at-a-time", help="An episode for each joint, the others held.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Decides orders, signs and phases.")] = 0,
    as_json: Json = False,
) -> None:
    """Write commands that tell effects apart, for your own robot to play and log.

    Example: [bold]bench excite --joints shoulder,elbow --range=-60:60deg --out commands.csv[/bold]
    """
    from benchmark import logs

    result = logs.excite(out, protocol, joints, ranges, limit, rate, seed, one_at_a_time)
    emit(result, as_json)


@app.command("import")
def import_logs(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="emps, bam or play-test.")],
    path: Annotated[Path, typer.Argument(metavar="PATH", help="Recorded file or folder of them.")],
    out: Annotated[Path, typer.Option(help="Folder of the log, or of several.")],
    form: Annotated[str, typer.Option(help="Form of the samples: parquet or csv.")] = "parquet",
    as_json: Json = False,
) -> None:
    """Bring a known recording of real hardware into the log format, with its mechanism.

    Example: [bold]bench import emps DATA_EMPS.mat --out logs/emps[/bold]
    """
    from benchmark import logs

    emit(logs.import_logs(kind, path, out, form), as_json)


@app.command()
def calibrate(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Folder of the log.")],
    backend: Annotated[
        str, typer.Option(help="Physics engine that stands for the nominal world.")
    ] = "mujoco",
    nominal_effects: Annotated[
        str | None,
        typer.Option(help="Effects of the nominal world, as for --effects. (those the log names)"),
    ] = None,
    threshold: Annotated[
        str | None,
        typer.Option(help="Pressed depth that counts as contact, such as 0.3mm. (from the noise)"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Decides every draw of the search.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Folder to write to. (calibrations/LOG)")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")] = False,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Calibrate the nominal world to a log: gains by CMA-ES, play by the push test, and the skin.

    Writes calibration.yaml, which `bench run --calibration` takes, and a picture per joint.

    Example: [bold]bench calibrate logs/one --out calibrations/one[/bold]
    """
    from benchmark import calibrate as calibrations

    settings = calibrations.Settings(
        path=log,
        backend=backend,
        nominal_effects=nominal_effects,
        threshold=threshold,
        seed=seed,
        workers=workers,
    )
    result, table = calibrations.run(settings, out, force)
    emit(result, as_json, table)


@app.command()
def diagnose(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Folder of the log.")],
    nominal: Annotated[
        str,
        typer.Option(
            help="Engine of the nominal world. Replays are compiled, for any engine alike; the "
            "nominal one is held against this engine, and a difference that matters is a warning."
        ),
    ] = "mujoco",
    effects_known: Annotated[
        str | None,
        typer.Option(help="Effects of the nominal world, as for --effects. (those the log names)"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder to write to. (diagnoses/LOG)")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")] = False,
    workers: Annotated[
        int | None, typer.Option(help="Cores to judge fingers on; changes no result. (all)", min=1)
    ] = None,
    as_json: Json = False,
) -> None:
    """Say where a log departs from the nominal world, which effect explains it, and how well.

    Writes diagnosis.json and report.html.

    Example: [bold]bench diagnose logs/one --effects-known built[/bold]
    """
    from benchmark import diagnose as diagnoses

    settings = diagnoses.Settings(
        path=log, nominal=nominal, effects_known=effects_known, workers=workers
    )
    result, summary = diagnoses.run(settings, out, force)
    emit(result, as_json, summary)


@app.command("speed")
def measure_speed(
    backend: Annotated[str | None, typer.Option(help="Physics engine. (all installed)")] = None,
    worlds: Annotated[
        str, typer.Option(help="Numbers of worlds at once, between commas.")
    ] = "16,64,256",
    workers: Annotated[
        str | None, typer.Option(help="Numbers of cores, between commas. (1,2 where there are two)")
    ] = None,
    seconds: Annotated[float, typer.Option(help="Time for each measurement, 0.1 to 600.")] = 4.0,
    seed: Annotated[int, typer.Option(help="Decides the worlds, drawn as for training.")] = 0,
    out: Out = None,
    as_json: Json = False,
) -> None:
    """Measure environment steps per second, beside the bare engine's in the same worlds.

    With --out, writes speed.csv, speed.json and a picture; docs/speed.md says what is measured.

    Example: [bold]bench speed --backend mujoco --worlds 64,256 --workers 1,2[/bold]
    """
    from benchmark import speed as speeds

    result, table = speeds.speed(speeds.plan(backend, worlds, workers, seconds, seed), out)
    emit(result, as_json, table)


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
def doctor(
    physics: Annotated[
        bool,
        typer.Option("--physics", help="Hold engines to closed forms and to one another (1 min)."),
    ] = False,
    backend: Annotated[
        str | None, typer.Option(help="With --physics: the one engine to check. (all)")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="With --physics: Markdown file for tables and reasons.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check every engine and learner: version, whether it works, and what would mend it.

    Example: [bold]bench doctor[/bold], or [bold]bench doctor --physics --backend bullet[/bold]
    """
    from benchmark.doctor import examine, examine_physics

    if not physics and (backend or out):
        raise errors.UsageError("--backend and --out belong to --physics: add it or leave them out")
    result, table = examine_physics(backend, out) if physics else examine()
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
