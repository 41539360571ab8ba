"""What makes the losses of a transfer matrix, as Markdown."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from leaderboard._grid import grid, plain
from leaderboard.causes import CELL, TOGETHER, WON
from leaderboard.transfer_text import interval, title

READING = (
    "Made by `bench transfer --explain`; not edited by hand. Each loss of `tracked` between two "
    "worlds, and the share of it that one difference wins back when it is switched: `there`, the "
    "deploy world becomes more like the train world; `at home`, the train world becomes more like "
    "the deploy world, because the deploy world's engine cannot have it. With 95 % intervals of "
    "the bootstrap over seeds and episodes."
)
HEAD = (
    *("trained in", "deployed in", "there", "here", "difference", "effects", "switched"),
    *("tracked with it", "won back"),
)


def markdown(lines: pd.DataFrame, notes: Sequence[str]) -> str:
    """The whole text; `notes` say what is missing and why."""
    parts = ["# What makes the losses", READING]
    kinds = [name for name in CELL if name not in ("train", "deploy")]
    for key, part in lines.groupby(kinds, sort=False):
        shared = dict(zip(kinds, key, strict=True))
        parts += [f"## {title(shared)}", grid(HEAD, [_row(one) for one in part.to_dict("records")])]
    if notes:
        parts += ["## Left out", "\n".join(f"- {plain(note)}" for note in notes)]
    return "\n\n".join(parts) + "\n"


def verdict(cell: pd.DataFrame) -> tuple[dict[str, Any], bool, dict[str, Any]]:
    """A cell's single difference that wins most back, whether it is the cause, and the best."""
    alone = cell[cell["difference"] != TOGETHER]
    first = alone.iloc[0].to_dict()
    return first, bool(first["won"] >= WON), cell.iloc[0].to_dict()


def _row(line: dict[str, Any]) -> list[str]:
    return [
        *(line["train"], line["deploy"], f"{line['home']:.2f}", f"{line['away']:.2f}"),
        *(line["difference"], line["effects"], line["switched"]),
        *(interval(line, "tracked", 2), interval(line, "won", 2)),
    ]
