"""`bench check`: what a log says, in words and in a picture, before anything is fitted."""

from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.text import Text

from benchmark.errors import UsageError
from benchmark.gap import robot_log
from benchmark.gap.asked import Source
from diagnosis.logs._columns import SHOWN
from diagnosis.logs.log import Log, LogError, MjcfMechanism
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import FaultError, triage

OUT, PICTURE = Path("checks"), "motion.png"
MOST_JOINTS, MOST_POINTS = 16, 4000
"""So many joints are drawn, and so many points of each."""


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
    _draw(found.log, folder / PICTURE)
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


def _draw(log: Log, file: Path) -> None:
    """Command and position: a row per joint, its episodes one after the other."""
    joints = log.joints[:MOST_JOINTS]
    figure = Figure(figsize=(11, 1.0 + 1.8 * len(joints)), layout="constrained")
    axes = figure.subplots(len(joints), 1, squeeze=False, sharex=True)[:, 0]
    for axis, joint in zip(axes, joints, strict=True):
        began_s, (size, unit, _) = 0.0, SHOWN[log.is_linear(joint)]
        for one in log.episodes:
            part = log.episode(one.episode)
            some = part.iloc[:: max(1, len(log.samples) // MOST_POINTS)]
            time_s = began_s + some["t_s"] - part["t_s"].iloc[0]
            axis.plot(time_s, size * some[log.column("command", joint)], color="tab:gray", lw=0.8)
            axis.plot(time_s, size * some[log.column("position", joint)], color="tab:blue", lw=1.0)
            began_s += float(part["t_s"].iloc[-1] - part["t_s"].iloc[0])
            axis.axvline(began_s, color="lightgray", lw=0.5)
        axis.set_ylabel(f"{joint} [{unit}]")
    axes[-1].set_xlabel("time [s]")
    axes[0].set_title("command (gray) and position (blue)", fontsize="small")
    figure.savefig(file, dpi=110)
