"""The five lines on top of the page: what is best, what transfers, what does not."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from files.tables import read_csv
from leaderboard._matrices import MATRIX_FILE
from leaderboard._wording import policy_name
from leaderboard.tables import Board

NAMES = ("task", "train", "deploy", "algo", "observation")
NUMBERS = ("retention", "retention_high", "floor_low")
"""Columns of a matrix that the summary reads."""
SHOWN = 3
"""Transfers that are named in a line."""
ADD = "bench leaderboard runs --add --out leaderboard"


def summary(board: Board, transfers: Iterable[Path]) -> list[tuple[str, str]]:
    """A heading and a sentence for each line; those without data are left out."""
    return list(_lines(board, transfers))


def _lines(board: Board, transfers: Iterable[Path]) -> Iterator[tuple[str, str]]:
    best = [_best(cells) for cells in _leaders(board)]
    if best:
        yield "Best", "; ".join(best) + "."
    away = _away(transfers)
    if len(away):
        least, floor = away["retention_high"], away["floor_low"]
        kept, lost = away[least >= floor], away[least < floor]
        yield "Transfers", _named(kept.sort_values("retention", ascending=False))
        yield "Does not transfer", _named(lost.sort_values("retention"))
    rows = sum(len(line.rows) for line in board.lines)
    verified = sum(line.cells["verified"] for line in board.lines)
    ranked = sum(not line.cells["unranked"] for line in board.lines)
    held = f"; the policies of {verified} were replayed and hold" if verified else ""
    yield (
        "Behind it",
        f"{rows} runs of {len(board.lines)} policies, {ranked} of them ranked{held}.",
    )
    yield "Add a row", ADD


def _leaders(board: Board) -> list[dict[str, Any]]:
    """Of every task the ranked policy that tracks best, whatever the engine; else the best one."""
    found: dict[str, dict[str, Any]] = {}
    for line in board.lines:
        new, old = line.cells, found.get(line.cells["task"])
        if old is None or _order(new) > _order(old):
            found[new["task"]] = new
    return list(found.values())


def _order(cells: dict[str, Any]) -> tuple[bool, float]:
    return not cells["unranked"], cells["tracked"]


def _best(cells: dict[str, Any]) -> str:
    return f"{cells['task']} {cells['tracked']:.2f} ({cells['backend']}: {policy_name(cells)})"


def _away(transfers: Iterable[Path]) -> pd.DataFrame:
    """Every cell of the matrices that is not its own world and has an interval."""
    found = []
    for folder in transfers:
        try:
            matrix = read_csv(folder / MATRIX_FILE)
            matrix = matrix.astype(dict.fromkeys(NAMES, str) | dict.fromkeys(NUMBERS, float))
            away = matrix[matrix["train"] != matrix["deploy"]]
            found.append(away.dropna(subset=["retention_high", "floor_low"]))
        except (OSError, KeyError, ValueError):
            continue  # the page says so where it would show the matrix
    return pd.concat(found).drop_duplicates() if found else pd.DataFrame()


def _named(lines: pd.DataFrame) -> str:
    """The first of some transfers, and how many there are."""
    if not len(lines):
        return "nothing."
    shown = [
        f"{one['task']} from {one['train']} to {one['deploy']} ({one['algo']}, "
        f"{one['observation']}) keeps {100 * one['retention']:.0f} % of tracked"
        for one in lines.drop_duplicates(["task", "train", "deploy"]).head(SHOWN).to_dict("records")
    ]
    return f"{'; '.join(shown)} ({len(lines)} cases below)."
