"""`bench speed`, `verify` and `list`: how fast it is, whether it holds, what there is."""

from typing import Annotated, Any

from benchmark.cli.command import command
from benchmark.cli.options import COUNT, Backends, Made, Out, Runs, Seed, Submission, Workers
from benchmark.errors import UsageError
from benchmark.settings.kinds import Counts, Number, Setting, Switch, Text
from benchmark.settings.run_spec import MOST_WORLDS
from files.plugins import KINDS


@command(defaults={"backend": "all", "workers": "1, and 2 where there are", "out": "none"})
def measure_speed(
    backend: Backends = "all",
    worlds: Annotated[
        tuple[int, ...],
        Setting(
            kind=Counts(Number(1, MOST_WORLDS, whole=True)),
            help="Numbers of worlds at once, between commas.",
        ),
    ] = (16, 64, 256),
    workers: Annotated[
        tuple[int, ...],
        Setting(kind=Counts(COUNT), letter="j", help="Numbers of cores, between commas."),
    ] = (),
    duration: Annotated[
        float,
        Setting(
            help="Time for each measurement, such as 500ms or 1min.", kind=Number(0.1, 600, "s")
        ),
    ] = 4.0,
    seed: Seed = 0,
    out: Made = None,
) -> Any:
    """Measure environment steps per second, and of the bare engine in the same worlds.

    With --out, writes speed.csv, speed.json and a picture; docs/results/speed.md says what is
    measured.

    Example: [bold]bench speed --backend mujoco --worlds 64,256 --workers 1,2[/bold]
    """
    from benchmark.speed import speed as speeds

    return speeds.speed(speeds.plan(backend, worlds, workers, duration, seed), out)


@command(
    defaults={"runs": "leaderboard/policies", "sample": "all", "out": "no row is marked"},
    kept="rows that were verified are marked",
)
def verify(
    runs: Runs = (),
    sample: Annotated[
        int | None, Setting(kind=COUNT, help="Replay so many of them, spread evenly.")
    ] = None,
    out: Out = None,
    workers: Workers = None,
) -> Any:
    """Replay policies and hold their scores against their rows; exit with 1 where one differs.

    With --out leaderboard, rows that hold carry a mark on the board.

    Example: [bold]bench verify leaderboard/policies --sample 5[/bold]
    """
    from benchmark.results.verify import verify

    return verify(runs, sample, out, workers)


@command(kept="nothing is written before all rows are replayed")
def submit(runs: Runs, out: Submission, workers: Workers = None) -> Any:
    """Write rows and policies for the board into one folder, each replayed first.

    Whoever keeps a board checks it with `bench verify DIR` and adds it to the board with
    `bench leaderboard DIR --add --policies`.

    Example: [bold]bench submit runs --out submission[/bold]
    """
    from benchmark.results.submit import submit as submits

    return submits(runs, out, workers)


@command(defaults={"kind": "all"})
def list_parts(
    kind: Annotated[
        str | None,
        Setting(
            kind=Text("KIND", ", ".join((*KINDS, "stick"))),
            help="One kind.",
            argument=True,
        ),
    ] = None,
    support: Annotated[
        bool, Setting(kind=Switch(), help="How each engine supports every number.")
    ] = False,
) -> Any:
    """Name every backend, task, observation, algorithm, effect, importer and stick.

    Example: [bold]bench list effect[/bold]
    """
    from benchmark.parts import listing

    if support and kind:
        raise UsageError(f"--support lists engines; leave '{kind}' or --support out")
    return listing.support() if support else listing.parts(kind)
