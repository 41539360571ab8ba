"""What the commands of the gap ask for: where a log comes from, and the nominal world."""

from dataclasses import dataclass
from pathlib import Path

from benchmark.errors import UsageError
from benchmark.settings.kinds import File, Name, Number, Switch, Text, setting
from benchmark.settings.run_spec import REFERENCE

OF_LOG = "those that the log names"
THRESHOLD_MM = 10.0
"""Largest sensible threshold of a taxel."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """A folder, or two files and what is asked of them."""

    folder: Path | None = setting(
        "Folder of the log.", File("LOG"), None, option="log-folder", argument=True
    )
    robot: Path | None = setting("MJCF or URDF of the robot.", File("MODEL"), None, shown="none")
    tables: tuple[Path, ...] = setting(
        "What it recorded: CSV, parquet or a ROS bag; a folder, or several, such as one a joint.",
        File("TABLE"),
        (),
        "log",
        shown="none",
        many=True,
    )
    unit: str | None = setting(
        "Of positions and commands: rad, deg, turn, mrad, m, mm, or 4096/turn@2048.",
        Text("UNIT"),
        None,
        shown="as the names say, or as the ranges do",
    )
    columns: tuple[str, ...] = setting(
        "Which column it is; kinds: command, position, motor, torque, velocity, push, reference, "
        "feedforward; repeatable.",
        Text("JOINT.KIND=COLUMN"),
        (),
        "column",
        shown="by their names",
        many=True,
    )
    drives: tuple[str, ...] = setting(
        "Numbers of a drive that the model lacks, such as '*=kp:60+-20%,ki:5'; repeatable.",
        Text("JOINT=NUMBERS"),
        (),
        "drive",
        shown="the model's",
        many=True,
    )
    servos: tuple[str, ...] = setting(
        "A servo that is known, such as 'sts3215@*' or 'xl330,volts:5.1@wrist'; repeatable.",
        Text("NAME@JOINT"),
        (),
        "servo",
        shown="none",
        many=True,
    )
    hold: tuple[str, ...] = setting(
        "Where a joint is held that the table lacks; repeatable.",
        Text("JOINT=POSITION"),
        (),
        shown="where the model has them",
        many=True,
    )
    fix_base: bool = setting("Hold a floating base where the model has it.", Switch(), False)
    gravity_compensation: bool = setting(
        "The drives carry the links' weight by themselves.", Switch(), False
    )

    @property
    def name(self) -> str:
        """Name of the folder or of the table."""
        place = self.folder or next(iter(self.tables), self.robot)
        if place is None:
            raise UsageError("give LOG, the folder of a log, or --robot MODEL and --log TABLE")
        return place.resolve().name if place.is_dir() and self.folder else place.resolve().stem


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of the nominal world."""

    known_effects: str | None = setting(
        "Effects that the nominal world is known to have, written as --effects is.",
        Text("SET"),
        None,
        shown=OF_LOG,
    )


@dataclass(frozen=True, kw_only=True)
class Nominal(Known):
    """The nominal world that a log is held against."""

    nominal: str = setting("Engine of the nominal world.", Name("backend"), REFERENCE)


@dataclass(frozen=True, kw_only=True)
class Calibration(Nominal):
    """What `bench calibrate` asks."""

    log: Path = setting("Folder of the log.", File("LOG"), argument=True)
    threshold_m: float | None = setting(
        "Pressed depth that counts as contact, such as 0.3mm.",
        Number(0, THRESHOLD_MM, "mm"),
        None,
        "threshold",
        shown="from the noise",
    )


@dataclass(frozen=True, kw_only=True)
class Diagnosis(Nominal, Source):
    """What `bench diagnose` asks."""

    healthy: tuple[Path, ...] = setting(
        "Log of the same mechanism, moved alike, while nothing was wrong, or the tables of one: "
        "residuals that such a log also shows are not attributed to a fault; repeatable.",
        File("LOG"),
        (),
        shown="none",
        many=True,
    )
