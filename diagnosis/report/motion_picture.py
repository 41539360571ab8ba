"""A picture of a log: command and position of every joint."""

from pathlib import Path

from matplotlib.figure import Figure

from diagnosis.logs._columns import SHOWN
from diagnosis.logs.log import Log

MOST_JOINTS, MOST_POINTS = 16, 4000
"""So many joints are drawn, and so many points of each."""


def draw(log: Log, file: Path) -> None:
    """Write the picture: a row per joint, its episodes one after the other."""
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
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)
