"""One picture per joint: recorded, nominal and calibrated motion."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backends.state import Array
from diagnosis.calibration.calibrate import Calibration
from diagnosis.calibration.result import Gains
from diagnosis.motion.batch import READINGS, Simulate, replay

EXCERPT_S = 0.6
"""Length of the excerpt, around the largest distance of nominal and recorded motion [s]."""
_COLOURS = {"recorded": "black", "nominal": "tab:orange", "calibrated": "tab:blue"}


def draw(simulate: Simulate, found: Calibration, folder: Path) -> list[Path]:
    """Write JOINT.png into a folder for every joint; returns the files."""
    shown = found.motions
    if not shown:
        return []
    replayed = replay(simulate, [found.nominal, found.calibrated], shown)
    files = []
    for j, joint in enumerate(found.nominal.hand.joint_names):
        gains = found.joints[joint].gains
        figure = Figure(figsize=(11, 2.1 * len(shown)), layout="constrained")
        axes = figure.subplots(len(shown), 2, squeeze=False)
        for row, motion, paths in zip(axes, shown, replayed, strict=True):
            moves = motion.protocol != "push"
            at = int(moves and isinstance(gains, Gains) and gains.compared == "motor")
            lines = np.stack([motion.measured[:, at, j], *paths[..., at, j]])
            _row(row, motion.time_s, np.degrees(lines))
            row[0].set_ylabel(f"{motion.protocol}\n{READINGS[at]} [deg]")
            row[1].set_ylabel("error [deg]")
        axes[0, 1].legend(loc="upper right", fontsize="small")
        axes[-1, 0].set_xlabel("time [s]")
        axes[-1, 1].set_xlabel("time [s]")
        figure.suptitle(joint)
        files.append(folder / f"{joint}.png")
        figure.savefig(files[-1], dpi=110)
    return files


def _row(row: Sequence[Axes], time_s: Array, deg: Array) -> None:
    """Recorded, nominal and calibrated angles (3, T): an excerpt, and all errors."""
    worst_s = time_s[int(np.argmax(np.abs(deg[1] - deg[0])))]
    begin_s = float(np.clip(worst_s - EXCERPT_S / 2, 0, max(time_s[-1] - EXCERPT_S, 0)))
    inside = (time_s >= begin_s) & (time_s <= begin_s + EXCERPT_S)
    for line, (name, colour) in zip(deg, _COLOURS.items(), strict=True):
        row[0].plot(time_s[inside], line[inside], color=colour, lw=1.2, label=name)
        if name != "recorded":
            row[1].plot(time_s, line - deg[0], color=colour, lw=1.0, label=f"{name} - recorded")
