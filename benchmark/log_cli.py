"""The options of `bench record`, `excite` and `import`: where logs come from."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import Backend, Effects, Form, Json, Stick, Workers
from benchmark.console import emit


def record(
    backend: Backend,
    out: Annotated[Path, typer.Option(help="Folder of the log; must not exist yet.")],
    protocol: Annotated[
        str,
        typer.Option(help="all, or some of steps,triangle,multisine,push,grasp,pull,policy."),
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
    form: Form = "parquet",
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


def import_logs(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="emps, bam or play-test.")],
    path: Annotated[Path, typer.Argument(metavar="PATH", help="Recorded file or folder of them.")],
    out: Annotated[Path, typer.Option(help="Folder of the log, or of several.")],
    form: Form = "parquet",
    as_json: Json = False,
) -> None:
    """Bring a known recording of real hardware into the log format, with its mechanism.

    Example: [bold]bench import emps DATA_EMPS.mat --out logs/emps[/bold]
    """
    from benchmark import logs

    emit(logs.import_logs(kind, path, out, form), as_json)
