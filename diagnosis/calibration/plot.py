"""One picture per joint: recorded, nominal and calibrated motion."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from backends.state import Array
from diagnosis.calibration.calibrate import Calibration

EXCERPT_S, MOST = 0.6, 8
"""Length of the excerpt, around the largest distance of nominal and recorded motion [s]; so many
episodes are drawn, or parts of them, at most."""
_COLOURS = {"recorded": "black", "nominal": "tab:orange", "calibrated": "tab:blue"}


def draw(found: Calibration, folder: Path) -> list[Path]:
    """Write JOINT.png into a folder for every joint; returns the files."""
    files = []
    for one in found.fits:
        worlds = one.read, one.angles(one.nominal), one.angles(one.numbers(one.scale))
        shown = one.limb.by_episode(np.degrees(np.stack(worlds, axis=1)))[:MOST]
        for j, joint in enumerate(one.limb.joints):
            figure = Figure(figsize=(11, 2.1 * len(shown)), layout="constrained")
            axes = figure.subplots(len(shown), 2, squeeze=False)
            rows = zip(axes, one.limb.recordings, one.limb.time_s, shown, strict=False)
            for row, recording, time_s, deg in rows:
                _row(row, time_s, deg[..., j].T)
                side = "motor" if one.by_motor[j] else "position"
                row[0].set_ylabel(f"{recording.protocol}\n{side} [deg]")
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
