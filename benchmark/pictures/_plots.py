"""The paper's figures for one run: drawn paths, joints over a lap, touch over time."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from benchmark.pictures._replay import Recording

ACTUAL, REFERENCE = "tab:blue", "tab:red"
MAPS = 3
"""Number of moments at which the taxels are shown."""
_TAXELS = ListedColormap(["#e8ecf2", "#d62728"])


def draw_figure(recording: Recording, title: str) -> Figure:
    """Draw lower end and reference in the X-Y plane [cm], from the grip; falls are marked."""
    figure = Figure(figsize=(6.4, 6.8), layout="constrained")
    axes = figure.add_subplot()
    half = 1.12 * draw_paths(axes, recording)
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set(xlabel="X from the grip [cm]", ylabel="Y from the grip [cm]")
    axes.set_title(title, fontsize=10)
    add_legend(axes)
    return figure


def draw_paths(axes: Axes, recording: Recording) -> float:
    """Reference and lower end of every episode [cm], from the grip; the farthest coordinate."""
    grip = np.array(recording.spec.hand.grip_m)[:2]
    reference_cm = 100 * (recording.reference_m[recording.first :, :, :2] - grip)
    actual_cm = 100 * (recording.lower_m[..., :2] - grip)
    reach_cm = [np.abs(reference_cm).max()]
    for e, steps_held in enumerate(recording.held.sum(axis=0)):
        axes.plot(*reference_cm[:, e].T, color=REFERENCE, lw=1.4, zorder=3, label="figure")
        reach_cm.append(_draw_path(axes, actual_cm[:, e], recording.first, steps_held))
    axes.grid(alpha=0.25)
    return max(reach_cm)


def add_legend(axes: Axes) -> None:
    """Name each kind of line once."""
    once = {label: line for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    axes.legend(once.values(), once.keys(), loc="upper right", fontsize=9)


def draw_joints(recording: Recording, title: str) -> Figure:
    """Draw target and measured position of every joint over one lap [deg], a finger per row."""
    lap = _drawn(recording, recording.lap)
    time_s = recording.time_s[lap]
    target_deg = np.degrees(recording.target_rad[lap])
    measured_deg = np.degrees(recording.states.measured_rad[lap])
    bodies = recording.spec.hand.driven
    rows = -(-len(bodies) // 2)
    figure = Figure(figsize=(8.4, 1.0 + 1.8 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    drawn = zip(axes[: len(bodies)], bodies, target_deg.T, measured_deg.T, strict=True)
    for one, body, reference, actual in drawn:
        one.plot(time_s, reference, color=REFERENCE, lw=1.2, label="asked for")
        one.plot(time_s, actual, color=ACTUAL, lw=1.2, label="measured")
        one.set_title(f"{body.joint.name}, {body.name.replace('_', ' ')}", fontsize=9)
        one.set_ylabel("[deg]", fontsize=9)
        one.grid(alpha=0.25)
    for one in axes[-2:]:
        one.set_xlabel("time [s]")
    axes[0].legend(fontsize=8)
    figure.suptitle(title, fontsize=10)
    return figure


def draw_touch(recording: Recording, title: str) -> Figure:
    """Draw contact positions on the fingertips over time [mm], and maps of active taxels."""
    touch, hand = recording.touch, recording.spec.hand
    part, lap = _drawn(recording, len(recording.time_s)), _drawn(recording, recording.lap)
    moments = np.linspace(lap.start, lap.stop, MAPS, endpoint=False).astype(int)
    center_mm = np.where(touch.in_contact[..., None], 1e3 * touch.center_m, np.nan)[part]
    count = len(hand.fingertips)
    figure = Figure(figsize=(11, 0.9 + 1.5 * count), layout="constrained")
    axes = figure.subplots(count, 1 + MAPS, width_ratios=(4, *[2] * MAPS), squeeze=False)
    for f, (line, *maps) in enumerate(axes):
        for name, values in zip("XYZ", center_mm[:, f].T, strict=True):
            line.plot(recording.time_s[part], values, lw=1.2, label=name)
        for moment in moments:
            line.axvline(recording.time_s[moment], color="black", alpha=0.25, lw=0.8)
        line.set_xlim(recording.time_s[part.start], recording.time_s[part.stop - 1] + 0.1)
        line.set_ylabel(f"{hand.fingertips[f].finger}\ncontact [mm]", fontsize=9)
        line.grid(alpha=0.25)
        for one, moment in zip(maps, moments, strict=True):
            grid = touch.active[moment, f].reshape(hand.taxels.rows, hand.taxels.columns)
            _draw_taxels(one, grid, f"{recording.time_s[moment]:.2f} s, {grid.sum()} active")
    axes[0, 0].legend(fontsize=8, ncols=3)
    axes[-1, 0].set_xlabel("time [s]")
    figure.suptitle(f"{title}\ntaxels: the fingertip points to the right", fontsize=10)
    return figure


def _drawn(recording: Recording, most: int) -> slice:
    """Up to `most` steps of episode 0 from the start of the figure, while the stick is held."""
    steps_held = int(recording.held[:, 0].sum())
    if steps_held < recording.first + recording.lap:
        return slice(0, max(steps_held, 1))
    return slice(recording.first, min(recording.first + most, steps_held))


def _draw_path(axes: Axes, path_cm: np.ndarray, first: int, steps_held: int) -> float:
    """Draw one episode's path (T, 2) [cm] until its fall; returns its largest coordinate [cm]."""
    line = path_cm[first:steps_held]
    axes.plot(*line.T, color=ACTUAL, lw=0.9, alpha=0.75, label="actual")
    if steps_held < len(path_cm):
        line = np.vstack([line, path_cm[max(steps_held - 1, 0)]])
        axes.plot(*line[-1], "x", color="black", ms=7, mew=1.6, zorder=4, label="dropped")
    return np.abs(line).max()


def _draw_taxels(axes: Axes, grid: np.ndarray, title: str) -> None:
    """Draw active taxels, shape (rows, columns), rows from rear (left) to front (right)."""
    axes.pcolormesh(grid.T, cmap=_TAXELS, vmin=0, vmax=1, edgecolors="white", lw=0.6)
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, fontsize=8)
    for side in axes.spines.values():
        side.set_visible(False)
