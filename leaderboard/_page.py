"""The leaderboard as one self-contained HTML page that fetches nothing."""

import base64
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image, UnidentifiedImageError

from files.tables import csv_text
from leaderboard import _svg, transfer_text
from leaderboard._matrices import matrices
from leaderboard._summary import summary
from leaderboard._wording import (
    COMPARING,
    MADE_BY,
    READING,
    count,
    figure_name,
    interval_text,
    policy_name,
    value_text,
)
from leaderboard.compare import Comparison
from leaderboard.curves import band
from leaderboard.paper import ENGINE, EPISODES, FIGURE, PAPER, PaperRow
from leaderboard.tables import WORLD, Board, Line

HEATMAP = "heatmap.png"
ERRORS = ("p_err_cm", "q_err_deg")
PLOTTED = (("reward", "mean reward per step", False), ("p_err_cm", "p_err [cm]", True))
"""The signals of a learning curve that are drawn, their labels, and whether the axis starts at
zero."""
FIGURES = (("tracked", 3), ("tracked_iqm", 3), ("held", 3), ("p_err_cm", 2), ("q_err_deg", 2))
"""Columns of a table, and their number of digits."""


class _Shown(NamedTuple):
    """A line and its colour; a policy has the same colour on the whole page."""

    line: Line
    color: str


def page(board: Board, pictures: Sequence[Path], transfers: Sequence[Path] = ()) -> str:
    """The whole page.

    `pictures` are PNG files that contain their captions. `transfers` are folders that `bench
    transfer` wrote.
    """
    environment = Environment(
        loader=PackageLoader("leaderboard", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    shown, broken = _pictures([*pictures, *(folder / HEATMAP for folder in transfers)])
    moved, unread = matrices(transfers)
    tasks = dict.fromkeys(line.cells["task"] for line in board.lines)
    return environment.get_template("_page.html.jinja").render(
        made_by=MADE_BY.replace("`", ""),
        summary=summary(board, transfers),
        csv=base64.b64encode(csv_text(board.frame, float_format="%.6g").encode()).decode(),
        reading=READING.replace("`", ""),
        comparing=COMPARING,
        tasks={task: _worlds(board, task) for task in tasks},
        comparisons=[_comparison(found) for found in board.comparisons],
        unranked=[
            line.cells | _names(line.cells) for line in board.lines if line.cells["unranked"]
        ],
        missing=[(row, policy_name(row.spec.model_dump())) for row in board.missing],
        problems=[*board.problems, *broken, *unread],
        transfers=moved,
        transfer_reading=transfer_text.READING.replace("`", ""),
        errors=transfer_text.ERRORS,
        pictures=shown,
    )


def _worlds(board: Board, task: str) -> list[dict[str, Any]]:
    """A table for each world in which policies of this task were trained."""
    names = sorted({policy_name(line.cells) for line in board.lines})
    colors = {name: _svg.COLORS[n % len(_svg.COLORS)] for n, name in enumerate(names)}
    worlds: dict[tuple, list[_Shown]] = {}
    for line in board.lines:
        if line.cells["task"] == task:
            hue = colors[policy_name(line.cells)]
            world = tuple(line.cells[name] for name in WORLD)
            worlds.setdefault(world, []).append(_Shown(line, hue))
    return [_world(PAPER.get(task), worlds[world]) for world in sorted(worlds)]


def _world(paper: PaperRow | None, lines: list[_Shown]) -> dict[str, Any]:
    most = {"tracked": 1.0}
    for score in ERRORS:
        values = [value for shown in lines for value in _drawn(shown.line, score)]
        most[score] = 1.1 * max(values + ([getattr(paper, score)] if paper else []))
    first = lines[0].line.cells
    return {
        "cells": first,
        "names": _names(first),
        "lines": [_line(shown, most, paper) for shown in lines],
        "paper": paper and (ENGINE, FIGURE, EPISODES, paper),
        "curves": _curves(lines),
    }


def _line(shown: _Shown, most: dict[str, float], paper: PaperRow | None) -> dict[str, Any]:
    cells = shown.line.cells
    return {
        "cells": cells,
        "names": _names(cells),
        "color": shown.color,
        "rank": "" if cells["unranked"] else str(cells["rank"]),
        "scores": [
            {
                "value": value_text(cells, score, digits),
                "interval": interval_text(cells, score, digits),
                "drawn": _cell(shown, score, most[score], paper) if score in most else "",
            }
            for score, digits in FIGURES
        ],
    }


def _cell(shown: _Shown, score: str, most: float, paper: PaperRow | None) -> str:
    cells, rows = shown.line.cells, shown.line.rows
    cell = _svg.Cell(
        value=cells[score],
        low=cells[f"{score}_low"],
        high=cells[f"{score}_high"],
        seeds=[getattr(row.scores, score) for row in rows],
        color=shown.color,
    )
    return _svg.cell(cell, most, getattr(paper, score, None))


def _names(cells: dict[str, Any]) -> dict[str, str]:
    return {"policy": policy_name(cells), "figure": figure_name(cells), "count": count(cells)}


def _drawn(line: Line, score: str) -> list[float]:
    """Every value of one score that is drawn of a line."""
    values = [getattr(row.scores, score) for row in line.rows]
    high = line.cells[f"{score}_high"]
    return values if math.isnan(high) else [*values, high]


def _curves(lines: list[_Shown]) -> list[str]:
    """The learning curves of the lines in which every row has one."""
    drawn = []
    for signal, label, from_zero in PLOTTED:
        bands = []
        for shown in lines:
            rows = shown.line.rows
            curves = [row.curve for row in rows if row.curve is not None]
            if len(curves) == len(rows):
                found = band([(curve.steps, getattr(curve, signal)) for curve in curves])
                bands.append((shown.color, found))
        if bands:
            drawn.append(_svg.plot(bands, label, from_zero))
    return drawn


def _comparison(found: Comparison) -> dict[str, Any]:
    return {
        "world": found.first,
        "figure": figure_name(found.first),
        "first": policy_name(found.first),
        "second": policy_name(found.second),
        "tasks": ", ".join(found.tasks),
        "seeds": "{} against {}".format(*found.seeds),
        "probability": found.probability,
    }


def _pictures(paths: Sequence[Path]) -> tuple[list[dict[str, str]], list[str]]:
    """Each picture as text with its caption and command; and the files that are no pictures."""
    shown, broken = [], []
    for path in paths:
        try:
            with Image.open(path) as image:
                text = getattr(image, "text", {})
        except (UnidentifiedImageError, OSError) as error:
            broken.append(f"{path.name}: cannot be shown ({error}); allowed: a PNG file")
            continue
        shown.append(
            {
                "title": text.get("Title", path.stem),
                "source": text.get("Source", ""),
                "data": base64.b64encode(path.read_bytes()).decode(),
            }
        )
    return shown, broken
