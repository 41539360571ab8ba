"""One picture per joint: recorded, nominal and calibrated motion."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from backends.state import Array
from diagnosis.calibration.calibrate import Calibration, JointGains
from diagnosis.calibration.worlds import READINGS, Motion, replay
from diagnosis.motion.batch import Simulate

EXCERPT_S = 0.6
"""Length of the excerpt, around the largest distance of nominal and recorded motion [s]."""
_STYLES = (
    ("recorded", "black", 1.6),
    ("nominal", "tab:orange", 1.0),
    ("calibrated", "tab:blue", 1.0),
)


def draw(simulate: Simulate, found: Calibration, folder: Path) -> list[Path]:
    """Write JOINT.png into a folder for every joint; returns the files."""
    pushed = [] if any(m.protocol == "push" for m in found.motions) else found.pushes[:1]
    shown = (*found.motions, *pushed)
    if not shown:
        return []
    replayed = replay(simulate, [found.nominal, found.calibrated], shown)
    drive_s = found.nominal.timing.drive_s
    files = []
    for j, joint in enumerate(found.nominal.hand.joint_names):
        gains = found.joints[joint]
        channel = gains.channel if isinstance(gains, JointGains) else 0
        figure = Figure(figsize=(11, 2.1 * len(shown)), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(shown), 2, squeeze=False)
        for row, motion, paths in zip(axes, shown, replayed, strict=True):
            at = 0 if motion.protocol == "push" else channel
            lines = np.stack([motion.read_rad[at, :, j], *paths[:, at, :, j]])
            _row(row, motion, drive_s, np.degrees(lines), READINGS[at])
        axes[0, 1].legend(loc="upper right", fontsize="small")
        axes[-1, 0].set_xlabel("time [s]")
        axes[-1, 1].set_xlabel("time [s]")
        figure.suptitle(joint)
        files.append(folder / f"{joint}.png")
        figure.savefig(files[-1], dpi=110)
    return files


def _row(row: Sequence[Axes], motion: Motion, drive_s: float, deg: Array, reading: str) -> None:
    """Recorded, nominal and calibrated angles (3, T): an excerpt, and all errors."""
    time_s = motion.tick * drive_s
    apart = np.abs(deg[1] - deg[0])
    worst_s = time_s[int(np.argmax(apart))]
    begin_s = float(np.clip(worst_s - EXCERPT_S / 2, 0, max(time_s[-1] - EXCERPT_S, 0)))
    inside = (time_s >= begin_s) & (time_s <= begin_s + EXCERPT_S)
    for line, (name, colour, width) in zip(deg, _STYLES, strict=True):
        row[0].plot(time_s[inside], line[inside], color=colour, lw=width, label=name)
    for line, (name, colour, width) in zip(deg[1:] - deg[0], _STYLES[1:], strict=True):
        row[1].plot(time_s, line, color=colour, lw=width, label=f"{name} - recorded")
    row[0].set_ylabel(f"{motion.protocol}\n{reading} [deg]")
    row[1].set_ylabel("error [deg]")
