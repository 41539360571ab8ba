"""Reading a log as a user has it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from diagnosis.logs import log as logs
from diagnosis.logs.log import Log


def read_log(
    path: Path | str | Sequence[Path | str],
    robot: Path | str | None = None,
    *,
    unit: str | None = None,
    columns: Mapping[str, str] | None = None,
) -> Log:
    """Read and check the log in a folder; raises LogError with the fault and what to do.

    With a robot's MJCF or URDF, the log is its table, or several. `unit` and `columns`, such as
    `{"elbow.command": "u2"}`, say what the names of columns do not.
    """
    several = [path] if isinstance(path, str | Path) else list(path)
    if robot is None and len(several) == 1:
        return logs.read_log(several[0])
    if robot is None:
        raise logs.LogError("several files are given and no robot; give its MJCF or URDF, too")
    from diagnosis.logs.two_files import Asked, pair
    from diagnosis.replay.alignment import with_moments

    asked = Asked(unit=unit, columns=columns or {})
    return with_moments(pair(Path(robot), [Path(one) for one in several], asked))
