"""What makes the losses of a transfer matrix, as a picture: a row per loss."""

from typing import IO, Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leaderboard.causes import CELL, TOGETHER, WON

ROW_IN, MARGIN_IN, WIDTH_IN = 0.32, 1.3, 9.0
"""Height of a row, of the margins, and width [inch]."""
TITLE = "Share of the loss that one difference wins back"
ENDS = (-0.25, 1.6)
"""Shares that are shown."""


def draw_causes(lines: pd.DataFrame, file: IO[bytes]) -> None:
    """Write the picture as PNG: of each loss, what every difference wins back."""
    cells = [part for _, part in lines.groupby(list(CELL), sort=False)]
    figure = Figure(figsize=(WIDTH_IN, len(cells) * ROW_IN + MARGIN_IN), layout="constrained")
    axes = figure.subplots()
    names = [*sorted(set(lines["difference"]) - {TOGETHER}), TOGETHER]
    for name, mark in zip(names, "osD^vPX*hd<>"[: len(names)], strict=True):
        _draw(axes, name, mark, cells)
    axes.axvline(0.0, color="0.6", lw=0.8)
    axes.axvline(WON, color="0.6", lw=0.8, ls="--")
    axes.set_yticks(range(len(cells)), [_title(part.iloc[0]) for part in cells], fontsize=8)
    axes.set(xlim=ENDS, ylim=(len(cells) - 0.5, -0.5), xlabel=TITLE)
    axes.legend(fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.4, 1.0), frameon=False)
    figure.savefig(file, format="png", dpi=110, metadata={"Title": TITLE})


def _draw(axes: Axes, name: str, mark: str, cells: list[pd.DataFrame]) -> None:
    rows = [
        (y, line)
        for y, part in enumerate(cells)
        for line in part[part["difference"] == name].to_dict("records")
    ]
    x = [min(max(line["won"], ENDS[0]), ENDS[1]) for _, line in rows]
    sides = [[line["won"] - line["won_low"], line["won_high"] - line["won"]] for _, line in rows]
    error = list(zip(*sides, strict=True)) if rows else None
    color = "black" if name == TOGETHER else None
    y = [place for place, _ in rows]
    axes.errorbar(x, y, xerr=error, fmt=mark, ms=5, lw=0.8, label=name, alpha=0.8, color=color)


def _title(line: Any) -> str:
    return f"{line['train']} to {line['deploy']} ({line['away'] - line['home']:+.2f})"
