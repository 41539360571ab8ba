"""What makes the losses of a transfer matrix: a difference of two worlds switched at a time.

A row of the episodes table is one episode of one policy of a cell (train and deploy world) in one
world: where it was trained (HOME), where it was deployed (AWAY), or one of these two with a named
difference switched. A difference that is switched `there` makes the deploy world more like the
train world; one that is switched `at home` makes the train world more like the deploy world.
"""

from typing import Any

import numpy as np
import pandas as pd

from leaderboard.statistics import Array, mean
from leaderboard.transfer import COLUMNS, IDENTITY, bootstrap, named

HOME, AWAY = "train world", "deploy world"
THERE, AT_HOME = "there", "at home"
TOGETHER = "all together"
"""The differences that can be switched there, all at once."""
CAUSES = (*(c for c in COLUMNS if c != "floor"), "difference", "effects", "switched")
"""Columns of the episodes table: `effects` are those of the world, `switched` says where."""
CELL = (*IDENTITY, "train", "deploy")
LEAST_LOSS, WON = 0.1, 0.7
"""Loss of `tracked` that is looked into, and share of it that a cause wins back."""


def losses(episodes: pd.DataFrame, least: float = LEAST_LOSS) -> list[tuple[Any, ...]]:
    """The cells of a matrix's episodes (`CELL`) whose mean `tracked` falls by at least so much."""
    means = episodes[~episodes["floor"]].groupby(list(CELL), sort=False)["tracked"].mean()
    home = {key[:-1]: value for key, value in means.items() if key[-1] == key[-2]}
    return [key for key, value in means.items() if home.get(key[:-1], value) - value >= least]


def causes(episodes: pd.DataFrame) -> pd.DataFrame:
    """One line per cell and switched difference, the one that wins most back first.

    `won` is the share of the loss that the difference wins back: there (switched - away) / (home -
    away), at home (home - switched) / (home - away). Intervals as in `leaderboard.transfer.matrix`.
    """
    lines = []
    for key, cell in episodes.groupby(list(CELL), sort=False):
        home, away = (_tracked(cell, name) for name in (HOME, AWAY))
        worlds = cell[cell["switched"] != ""].groupby(["difference", "effects", "switched"])
        found = [_line(part, names, home, away) for names, part in worlds]
        shared = dict(zip(CELL, key, strict=True))
        lines += [{**shared, **one} for one in sorted(found, key=lambda one: -one["won"])]
    return pd.DataFrame(lines)


def best(lines: pd.DataFrame) -> list[dict[str, Any]]:
    """Of each cell the single difference that wins most back."""
    alone = lines[lines["difference"] != TOGETHER]
    return [part.iloc[0].to_dict() for _, part in alone.groupby(list(CELL), sort=False)]


def _line(part: pd.DataFrame, names: tuple, home: pd.DataFrame, away: pd.DataFrame) -> dict:
    difference, effects, switched = names
    there = part.pivot(index="policy", columns="episode", values="tracked")
    scores = [table.loc[there.index].to_numpy() for table in (home, away, there)]
    statistic = _won_there if switched == THERE else _won_at_home
    return {
        "difference": difference,
        "effects": effects,
        "switched": switched,
        "seeds": len(there),
        "episodes": there.shape[1],
        "home": scores[0].mean(),
        "away": scores[1].mean(),
        **named("tracked", bootstrap(mean, scores[2])),
        **named("won", bootstrap(statistic, *scores)),
    }


def _tracked(cell: pd.DataFrame, name: str) -> pd.DataFrame:
    """`tracked` of S policies in E episodes, shape (S, E)."""
    part = cell[(cell["difference"] == name) & (cell["switched"] == "")]
    return part.pivot(index="policy", columns="episode", values="tracked")


def _won_there(home: Array, away: Array, switched: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return (mean(switched) - mean(away)) / (mean(home) - mean(away))


def _won_at_home(home: Array, away: Array, switched: Array) -> Array:
    return _won_there(away, home, switched)
