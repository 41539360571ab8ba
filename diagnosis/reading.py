"""Reading a log as a user has it."""

from pathlib import Path

from diagnosis.logs import log as logs
from diagnosis.logs.log import Log


def read_log(path: Path | str, robot: Path | str | None = None) -> Log:
    """Read and check the log in a folder; raises LogError with the fault and what to do.

    With a robot's MJCF or URDF, `path` is the table that it recorded.
    """
    log = logs.read_log(path, robot)
    if robot is None:
        return log
    from diagnosis.replay.alignment import with_commands_first

    return with_commands_first(log)
