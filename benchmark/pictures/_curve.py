"""Learning curves of one or several runs; runs that differ only in the seed become one band."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmark.errors import UsageError
from benchmark.runs import run_folder
from benchmark.settings.run_spec import RunSpec
from leaderboard.curves import Band, band, thin

POINTS = 100
"""Number of points of a curve."""
PANELS = (
    ("reward", "mean reward per step"),
    ("p_err_cm", "error of the lower end [cm]"),
    ("q_err_deg", "error of the axis [deg]"),
)


def read_curves(folders: Sequence[Path]) -> dict[RunSpec, list[dict[str, np.ndarray]]]:
    """Learning curves, grouped by all settings but the seed; UsageError for a run without one."""
    curves: dict[RunSpec, dict[int, dict]] = {}
    for folder in folders:
        run = run_folder.read_run(folder)
        spec = run_folder.run_spec(run)
        progress = run_folder.RunFolder(folder, spec).progress(up_to_steps=spec.steps * 2)
        if not progress:
            raise UsageError(f"{folder} has no learning curve: {spec.algo} was not trained there")
        columns = {name: [row[name] for row in progress] for name in progress[0]}
        seeds = curves.setdefault(dataclasses.replace(spec, seed=0), {})
        seeds[spec.seed] = thin(columns, POINTS)
    return {spec: list(seeds.values()) for spec, seeds in curves.items()}


def draw_curves(curves: dict[RunSpec, list[dict[str, np.ndarray]]], title: str) -> Figure:
    """Draw the mean over seeds, and the range from lowest to highest."""
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    labels = _labels(list(curves))
    for axes, (signal, name) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        for label, seeds in zip(labels, curves.values(), strict=True):
            found = band([(seed["steps"], seed[signal]) for seed in seeds])
            _draw(axes, found, f"{label} ({found.seeds} seed{'s' * (found.seeds > 1)})")
        axes.set(xlabel="environment steps", ylabel=name)
        axes.ticklabel_format(axis="x", style="sci", scilimits=(6, 6))
        axes.grid(alpha=0.25)
        if signal != "reward":
            axes.set_ylim(bottom=0)
    shown = figure.axes[0].get_legend_handles_labels()
    figure.legend(*shown, fontsize=8, loc="outside lower center", ncols=3)
    figure.suptitle(title, fontsize=10)
    return figure


def _draw(axes, found: Band, label: str) -> None:
    (line,) = axes.plot(found.steps, found.mean, lw=1.4, label=label)
    if found.seeds > 1:
        axes.fill_between(found.steps, found.low, found.high, color=line.get_color(), alpha=0.2)


def _labels(specs: Sequence[RunSpec]) -> list[str]:
    """Labels of the runs: the settings in which they differ; for a single run its names."""
    fields = [dataclasses.asdict(spec) for spec in specs]
    named = ("backend", "task", "algo", "observation")
    shown = [name for name in fields[0] if len({str(f[name]) for f in fields}) > 1] or list(named)
    return [
        ", ".join(
            str(f[name]) if isinstance(f[name], str) else f"{name} {f[name]}" for name in shown
        )
        for f in fields
    ]
