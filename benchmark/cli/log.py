"""`bench record`, `excite` and `import`: where logs come from."""

from pathlib import Path
from typing import Annotated, Any

from backends.spec import Timing
from benchmark.cli.command import command
from benchmark.cli.options import (
    Force,
    Format,
    NewFolder,
    OutFile,
    Policy,
    Protocol,
    Seed,
    Workers,
)
from benchmark.gap.asked import Known
from benchmark.settings.kinds import File, Name, Number, Setting, Switch, Text
from benchmark.settings.run_spec import WORLD, settings_for

NONE = "none"
MANY = Number(1, 1000, whole=True)
FASTEST_HZ = 1 / Timing.drive_s


@command(
    settings_for(WORLD),
    required=("backend",),
    defaults={"known_effects": NONE, "policy": "none"},
)
def record(
    settings: dict[str, Any],
    out: NewFolder,
    known: Known,
    protocol: Protocol = "all",
    policy: Policy = None,
    channels: Annotated[
        str,
        Setting(
            kind=Text("NAMES"),
            help="all, or some of motor, torque, velocity, push, touch, stick, or contact for "
            "touch as yes or no; command and position are always there.",
        ),
    ] = "all",
    rate: Annotated[
        float, Setting(kind=Number(1 / Timing.policy_s, FASTEST_HZ, "Hz"), help="Samples a second.")
    ] = 200.0,
    variants: Annotated[
        int,
        Setting(help="Episodes per protocol, each with other phases and grips.", kind=MANY),
    ] = 1,
    repeats: Annotated[
        int,
        Setting(help="Times that each is repeated with other sensor noise.", kind=MANY),
    ] = 1,
    seed: Seed = 0,
    form: Format = "parquet",
    force: Force = False,
    workers: Workers = None,
) -> Any:
    """Run the excitation protocols on an engine and write a log as a robot's would be.

    The log names hand and stick; the effects stand in its provenance.json, which a diagnosis does
    not read.

    Example: [bold]bench record --backend mujoco --effects backlash=1.5deg@J3 --out logs/one[/bold]
    """
    from benchmark.gap import record as records

    world = records.world(settings, known.known_effects or NONE, policy, workers)
    plan = records.plan(world, protocol, channels, rate, variants, repeats, seed)
    return records.record(world, plan, out, form, force)


@command(defaults={"joints": "the TRX hand's", "ranges": "the hand's", "limit": "no push"})
def excite(
    out: OutFile,
    protocol: Protocol = "all",
    joints: Annotated[
        str | None, Setting(kind=Text("NAMES"), help="Your joints, between commas.")
    ] = None,
    ranges: Annotated[
        str | None,
        Setting(
            name="range",
            kind=Text("RANGE"),
            help="Where they may move: -60:60deg, 0:0.2m; one, or one each between commas. "
            "Commands reach 45 % of the way from its centre to its ends.",
        ),
    ] = None,
    limit: Annotated[
        str | None,
        Setting(
            kind=Text("LOAD"),
            help="Largest torque or force of the drives, such as 15Nm or 40N; one, or one each "
            "between commas. Pushes are 30 % of it.",
        ),
    ] = None,
    rate: Annotated[
        float, Setting(kind=Number(20, FASTEST_HZ, "Hz"), help="Samples a second.")
    ] = 200.0,
    one_at_a_time: Annotated[
        bool, Setting(kind=Switch(), help="An episode for each joint, the others held.")
    ] = False,
    seed: Seed = 0,
    force: Force = False,
) -> Any:
    """Write commands that make effects distinguishable, as CSV, for your own robot to play and log.

    Example: [bold]bench excite --joints shoulder,elbow --range=-60:60deg --out commands.csv[/bold]
    """
    from benchmark.gap import logs

    return logs.excite(out, protocol, joints, ranges, limit, rate, seed, one_at_a_time, force)


@command()
def import_logs(
    kind: Annotated[
        str, Setting(kind=Name("importer", "KIND"), help="Kind of recording.", argument=True)
    ],
    path: Annotated[
        Path, Setting(kind=File("PATH"), help="Recorded file or folder of them.", argument=True)
    ],
    out: NewFolder,
    form: Format = "parquet",
    force: Force = False,
) -> Any:
    """Bring a known recording of real hardware into the log format, with its mechanism.

    Several logs of one recording go to folders in the one that is written.

    Example: [bold]bench import emps DATA_EMPS.mat --out logs/emps[/bold]
    """
    from benchmark.gap import logs

    return logs.import_logs(kind, path, out, form, force)
