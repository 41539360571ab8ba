"""The options of `bench speed`, `list` and `doctor`: what is installed, and how good it is."""

from pathlib import Path
from typing import Annotated

import typer

from benchmark._options import Json, Out
from benchmark.console import emit
from benchmark.errors import UsageError


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
        raise UsageError("--backend and --out belong to --physics: add it or leave them out")
    result, table = examine_physics(backend, out) if physics else examine()
    emit(result, as_json, table)
    if not result["ok"]:
        raise typer.Exit(1)
