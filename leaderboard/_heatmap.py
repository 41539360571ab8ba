"""The transfer matrix as a picture: a panel per kind of policy, a row per train world."""

import math
import textwrap
from typing import IO, Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leaderboard.transfer_text import FLOOR, Panel, interval, panels, title

CELL_IN = (1.35, 0.75)
"""Width and height of a cell [inch]."""
MARGIN_IN = (2.6, 1.5)
"""Margins of a panel: left and right, above and below [inch]."""
TITLE = "Transfer: mean tracked as shade and number, retention below it"
LETTERS = 17
"""Letters of a line of a world's name."""
DARK = 0.55
"""Cells with shades above this have dark text."""


def draw_heatmap(matrix: pd.DataFrame, file: IO[bytes]) -> None:
    """Write the matrix as PNG, see `heatmap`."""
    about = {"Title": TITLE, "Source": "bench transfer"}
    heatmap(matrix).savefig(file, format="png", dpi=110, metadata=about)


def heatmap(matrix: pd.DataFrame) -> Figure:
    """The matrix as a picture: shade and first line `tracked`, second line retention."""
    parts = panels(matrix)
    columns = max(len(part.deploy) for part in parts) + 1
    heights = [len(part.train) * CELL_IN[1] + MARGIN_IN[1] for part in parts]
    width = columns * CELL_IN[0] + MARGIN_IN[0]
    figure = Figure(figsize=(width, sum(heights)), layout="constrained")
    axes = figure.subplots(len(parts), squeeze=False, height_ratios=heights)[:, 0]
    for place, part in zip(axes, parts, strict=True):
        _draw(place, part)
    return figure


def _draw(axes: Axes, part: Panel) -> None:
    shades = [[_shade(part, train, world) for world in part.deploy] for train in part.train]
    blank = [[*row, math.nan] for row in shades]
    picture = axes.imshow(blank, vmin=0, vmax=1, cmap="viridis", aspect="auto")
    axes.figure.colorbar(picture, ax=axes, label="tracked", pad=0.01)
    worlds = [*part.deploy, FLOOR]
    axes.set_xticks(range(len(worlds)), map(_wrapped, worlds), fontsize=8)
    axes.set_yticks(range(len(part.train)), map(_wrapped, part.train), fontsize=8)
    axes.set(xlabel="deployed in", ylabel="trained in")
    axes.set_title(title(part.shared), fontsize=9)
    axes.spines[:].set_visible(False)
    for y, train in enumerate(part.train):
        for x, world in enumerate(part.deploy):
            if (line := part.lines.get((train, world))) is not None:
                light = "black" if shades[y][x] > DARK else "white"
                axes.text(x, y, _score(line), ha="center", va="center", fontsize=7, color=light)
        floor = f"× {interval(part.any_line(train), 'floor', 2)}"
        axes.text(len(part.deploy), y, floor, ha="center", va="center", fontsize=7)


def _wrapped(world: str) -> str:
    """A world's name in short lines, broken between effects and words first."""
    return textwrap.fill(world.replace(",", ", "), LETTERS)


def _shade(part: Panel, train: str, world: str) -> float:
    line = part.lines.get((train, world))
    return math.nan if line is None else line["tracked"]


def _score(line: dict[str, Any]) -> str:
    return f"{interval(line, 'tracked', 2)}\n× {interval(line, 'retention', 2)}"
