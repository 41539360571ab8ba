"""Where a log comes from, as `bench check` and `bench diagnose` ask for it."""

from dataclasses import dataclass
from pathlib import Path

from benchmark.errors import UsageError
from benchmark.settings.options import option


@dataclass(frozen=True, kw_only=True)
class Source:
    """A folder, or two files and what is asked of them."""

    folder: Path | None = option("Folder of the log.", "[LOG]", argument=True)
    robot: Path | None = option("MJCF or URDF of the robot.", "MODEL", shown="none")
    table: Path | None = option(
        "What it recorded: CSV, parquet or a ROS bag.", "TABLE", name="log", shown="none"
    )
    unit: str | None = option(
        "Of positions and commands: rad, deg, turn, mrad, m, mm.",
        "UNIT",
        shown="as the names say, or as the ranges do",
    )
    columns: list[str] | None = option(
        "Which column it is; kinds: command, position, motor, torque, velocity, push, reference, "
        "feedforward; repeatable.",
        "JOINT.KIND=COLUMN",
        name="column",
        shown="by their names",
    )
    drives: list[str] | None = option(
        "Numbers of a drive that the model lacks, such as '*=kp:60+-20%,kd:1.5,limit:12,ki:5'; "
        "repeatable.",
        "JOINT=NUMBERS",
        name="drive",
        shown="the model's",
    )
    servos: list[str] | None = option(
        "A servo that is known, such as 'sts3215@*' or 'xl330,gain:800,volts:5.1@wrist'; "
        "repeatable.",
        "NAME@JOINT",
        name="servo",
        shown="none",
    )
    hold: list[str] | None = option(
        "Where a joint is held that the table lacks; repeatable.",
        "JOINT=POSITION",
        shown="where the model has them",
    )
    fix_base: bool = option("Hold a floating base where the model has it.", default=False)
    gravity_compensation: bool = option(
        "The drives carry the links' weight by themselves.", default=False
    )

    @property
    def name(self) -> str:
        """Name of the folder or of the table."""
        place = self.folder or self.table or self.robot
        if place is None:
            raise UsageError("give LOG, the folder of a log, or --robot MODEL and --log TABLE")
        return place.resolve().stem if self.folder is None else place.resolve().name
