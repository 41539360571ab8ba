"""`bench check`: what a log says, in words and in a picture, before anything is fitted."""

from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from benchmark.errors import UsageError
from benchmark.gap import robot_log
from benchmark.gap.asked import Source
from diagnosis.logs.log import Log, LogError, MjcfMechanism
from diagnosis.replay.nominal import mjcf_world
from diagnosis.report.motion_picture import draw
from diagnosis.triage.triage import FaultError, triage

OUT, PICTURE = Path("checks"), "motion.png"


def run(source: Source, out: Path | None, force: bool) -> tuple[dict, RenderableType]:
    """Read a log, say what was understood, and draw it; returns the result and its lines.

    Raises UsageError for a log that cannot be used.
    """
    folder = out or OUT / source.name
    try:
        found = robot_log.read(source, folder, force)
        lines = [*found.said, *robot_log.understood(found.log)]
        faults, remarks = _judged(found.log)
    except LogError as error:
        raise UsageError(str(error)) from error
    folder.mkdir(parents=True, exist_ok=True)
    draw(found.log, folder / PICTURE)
    written = [str(folder / PICTURE), *([str(found.folder)] if found.said else [])]
    result = {
        "status": "done",
        "ok": not faults,
        "dir": str(folder),
        "log": str(found.folder),
        "joints": list(found.log.joints),
        "understood": lines,
        "faults": faults,
        "warnings": remarks,
        "written": written,
    }
    end = [f"Warning: {text}" for text in remarks]
    end += [*(f"Fault: {text}" for text in faults), f"Wrote {', '.join(written)}."]
    end.append(f"Next: bench diagnose {found.folder}")
    return result, Group(*map(Text, [*lines, *end]))


def _judged(log: Log) -> tuple[list[str], list[str]]:
    """What is wrong with the data of a user's robot, and what may be."""
    if not isinstance(log.meta.mechanism, MjcfMechanism):
        return [], []
    try:
        return [], list(triage(log, mjcf_world(log)))
    except FaultError as error:
        return [str(fault) for fault in error.faults], []
    except LogError as error:
        return [str(error)], []
