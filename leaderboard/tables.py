"""Make a board from rows: the scores of each policy over its seeds, with intervals and ranks."""

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from leaderboard.compare import Comparison, Entry, compare
from leaderboard.details import SCORES
from leaderboard.paper import PAPER
from leaderboard.row import Row
from leaderboard.rows import unique
from leaderboard.statistics import estimate, interquartile_mean, mean
from leaderboard.verified import count_verified

MIN_SEEDS = 3
"""With fewer seeds a row has values, but no interval and no rank."""
WORLD = ("backend", "effects", "stick", "spec_digest", "radius_m", "speed")
"""What the rows of one table have in common: the simulated world and the settings of the task."""
RANKED_TOGETHER = ("task", "radius_m", "speed", "backend", "spec_digest", "steps")
"""Rows are ranked together if these are equal: the task with its settings, the world, the
budget."""
IDENTITY = (
    *("task", "backend", "effects", "stick", "observation", "algo"),
    *("radius_m", "speed", "randomize", "spread", "start_spread", "steps"),
)
PARTS = ("", "_std", "_low", "_high", "_iqm", "_iqm_low", "_iqm_high")
"""Statistics of each score: mean, sample standard deviation over seeds, interquartile mean,
intervals."""
COLUMNS = (
    *("rank", *IDENTITY, "seeds", "verified", "episodes"),
    *(f"{score}{part}" for score in SCORES for part in PARTS),
    *("wall_s", "env_steps_per_s", "spec_digest", "versions", "command", "unranked"),
)
BENEATH = frozenset(
    {"gymnasium", "numpy", "onnx", "onnxruntime", "pandas", "pydantic", "python", "scipy"}
    | {"stickbench", "torch"}
)
"""Packages that are neither engine nor learner; the table leaves out their versions."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One policy in one world: its rows, which differ only in the seed."""

    rows: tuple[Row, ...]
    """Its rows, sorted by seed."""
    cells: dict[str, Any]
    """Its cells in the table, by `COLUMNS`."""


@dataclass(frozen=True, kw_only=True)
class Board:
    """The contents of the leaderboard's files."""

    lines: tuple[Line, ...]
    """Lines, sorted per task by mean `tracked`, descending."""
    comparisons: tuple[Comparison, ...]
    missing: tuple[Row, ...]
    """Runs that are not done."""
    problems: tuple[str, ...]
    """Files that could not be read, and why."""

    @property
    def frame(self) -> pd.DataFrame:
        """The table, a line per policy and world."""
        frame = pd.DataFrame([line.cells for line in self.lines], columns=list(COLUMNS))
        return frame.astype({"rank": "Int64"})


def board(
    rows: Sequence[Row],
    problems: Sequence[str] = (),
    smoke: bool = False,
    verified: Mapping[str, dict] | None = None,
) -> Board:
    """One line per run identity without seed; smoke runs only with `smoke`, and without rank.

    Scores are means over seeds and episodes. Figures that cannot be computed are NaN: the deviation
    of one seed, the interval under `MIN_SEEDS`, the interquartile mean without scores per episode.
    `unranked` says why `rank` is blank, `verified` how many of its rows carry one of these marks.
    """
    groups: dict[str, list[Row]] = {}
    for row in unique(rows):
        if row.status == "done" and (smoke or not row.spec.smoke):
            groups.setdefault(_identity(row), []).append(row)
    lines = [Line(rows=tuple(groups[key]), cells=_cells(groups[key])) for key in sorted(groups)]
    for line in lines:
        line.cells["rank"] = _rank(line, lines)
        line.cells["verified"] = count_verified([row.key for row in line.rows], verified or {})
    lines.sort(key=lambda line: (_task_order(line.cells["task"]), -line.cells["tracked"]))
    missing = [row for row in unique(rows) if row.status != "done"]
    return Board(
        lines=tuple(lines),
        comparisons=tuple(compare([_entry(line) for line in lines if not line.cells["unranked"]])),
        missing=tuple(row for row in missing if smoke or not row.spec.smoke),
        problems=tuple(sorted(set(problems))),
    )


def scores_of(rows: Sequence[Row], score: str) -> np.ndarray:
    """One score of each seed and episode, shape (S, E); (S, 1) where only means were kept."""
    lists = [getattr(row.episodes, score) for row in rows if row.episodes is not None]
    if len(lists) == len(rows) and len({len(values) for values in lists}) == 1:
        return np.array(lists)
    return np.array([[getattr(row.scores, score)] for row in rows])


def _identity(row: Row) -> str:
    spec = row.spec.model_dump(mode="json", exclude={"seed"})
    return json.dumps([spec, row.spec_digest], sort_keys=True)


def _cells(rows: list[Row]) -> dict[str, Any]:
    first, seeds = rows[0], len({row.spec.seed for row in rows})
    cells: dict[str, Any] = {name: getattr(first.spec, name) for name in IDENTITY}
    cells["algo"] = first.spec.learner
    for score in SCORES:
        figures = _figures(rows, score, seeds)
        cells |= {f"{score}{part}": figures.get(part, float("nan")) for part in PARTS}
    for name in ("wall_s", "env_steps_per_s"):
        cells[name] = statistics.fmean(getattr(row, name) for row in rows)
    unlike = "smoke run" if first.spec.smoke else ""
    if first.spec.start_sha256 is not None:
        unlike = "starts from a trained policy"
    few = f"{seeds} of at least {MIN_SEEDS} seeds" if seeds < MIN_SEEDS else ""
    return cells | {
        "seeds": seeds,
        "episodes": sum(row.scores.episodes for row in rows if row.scores),
        "spec_digest": first.spec_digest,
        "versions": _versions(rows),
        "command": first.provenance.command,
        "unranked": unlike or few,
    }


def _figures(rows: list[Row], score: str, seeds: int) -> dict[str, float]:
    """The statistics of one score, by the names in `PARTS`."""
    means = [getattr(row.scores, score) for row in rows]
    figures = {"": statistics.fmean(means)}
    if len(means) > 1:
        figures["_std"] = statistics.stdev(means)
    scores = scores_of(rows, score)
    if seeds >= MIN_SEEDS:
        interval = estimate([scores], mean)
        figures |= {"_low": interval.low, "_high": interval.high}
    if scores.shape[1] > 1:
        middle = estimate([scores], interquartile_mean)
        figures["_iqm"] = middle.value
        if seeds >= MIN_SEEDS:
            figures |= {"_iqm_low": middle.low, "_iqm_high": middle.high}
    return figures


def _versions(rows: list[Row]) -> str:
    """Names and versions of packages that are not in `BENEATH`; different versions are joined."""
    pairs = {pair for row in rows for pair in row.provenance.versions.items()}
    names = sorted({name for name, _ in pairs} - BENEATH)
    return ", ".join(
        f"{name} {'/'.join(sorted(v for n, v in pairs if n == name))}" for name in names
    )


def _rank(line: Line, lines: list[Line]) -> int | None:
    """The rank: one more than the number of better lines; equal scores share a rank."""
    own = line.cells
    if own["unranked"]:
        return None
    others = [other.cells for other in lines if not other.cells["unranked"]]
    rivals = [o for o in others if all(own[name] == o[name] for name in RANKED_TOGETHER)]
    return 1 + sum(bool(other["tracked"] > own["tracked"]) for other in rivals)


def _entry(line: Line) -> Entry:
    spec = line.rows[0].spec.model_dump(mode="json")
    shared = ("task", *WORLD, "steps")
    policy = {k: v for k, v in spec.items() if k not in (*shared, "seed")}
    return Entry(
        task=line.cells["task"],
        world=tuple(line.cells[name] for name in (*WORLD, "steps")),
        policy=json.dumps(policy, sort_keys=True),
        cells=line.cells,
        scores=scores_of(line.rows, "tracked"),
    )


def _task_order(task: str) -> tuple[int, str]:
    known = list(PAPER)
    return (known.index(task) if task in known else len(known), task)
