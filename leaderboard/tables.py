"""Rows to tables: mean and spread over seeds, ranks, and the CSV and Markdown files."""

import json
import os
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from leaderboard._markdown import markdown
from leaderboard.paper import PAPER
from leaderboard.rows import Row, unique

MIN_SEEDS = 3
"""With fewer seeds a row has values and no rank."""
RANKED_TOGETHER = ("task", "radius_m", "speed", "backend", "spec_digest", "steps")
"""Rows compete where these are equal: the task with its settings, the world, the budget."""
IDENTITY = (
    *("task", "backend", "effects", "stick", "observation", "algo"),
    *("radius_m", "speed", "randomize", "steps"),
)
SCORES = ("tracked", "held", "p_err_cm", "q_err_deg")
COLUMNS = (
    *("rank", *IDENTITY, "seeds"),
    *(f"{score}{part}" for score in SCORES for part in ("", "_std")),
    *("wall_s", "env_steps_per_s", "spec_digest", "versions", "command", "unranked"),
)
BENEATH = frozenset(
    {"gymnasium", "numpy", "onnx", "onnxruntime", "pandas", "pydantic", "python", "scipy"}
    | {"stickbench", "torch"}
)
"""Packages whose versions the table leaves out: neither engine nor learner."""


def table(rows: Sequence[Row], smoke: bool = False) -> pd.DataFrame:
    """One line per run identity without its seed, sorted per task by mean `tracked`, descending.

    Scores are means over the seeds; `*_std` is the sample standard deviation, NaN for one seed.
    `unranked` says why `rank` is blank. Smoke runs appear only with `smoke`, and unranked.
    """
    groups: dict[str, list[Row]] = {}
    for row in unique(rows):
        if row.status == "done" and (smoke or not row.spec.smoke):
            groups.setdefault(_identity(row), []).append(row)
    lines = [_line(groups[identity]) for identity in sorted(groups)]
    for line in lines:
        line["rank"] = _rank(line, lines)
    lines.sort(key=lambda line: (_task_order(line["task"]), -line["tracked"]))
    frame = pd.DataFrame(lines, columns=list(COLUMNS))
    return frame.astype({"rank": "Int64"})


def write_csv(frame: pd.DataFrame, path: Path) -> None:
    """Write the table as CSV, numbers to six digits, blank where there is none."""
    _write(path, frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"))


def write_markdown(
    frame: pd.DataFrame,
    rows: Sequence[Row],
    problems: Sequence[str],
    path: Path,
    smoke: bool = False,
) -> None:
    """Write the table as Markdown, and below it what is not ranked and why.

    `rows` are those the table was made of, `problems` the messages of `read_rows`.
    """
    missing = [row for row in unique(rows) if row.status != "done"]
    listed = [row for row in missing if smoke or not row.spec.smoke]
    _write(path, markdown(frame, listed, sorted(set(problems))))


def _identity(row: Row) -> str:
    spec = row.spec.model_dump(mode="json", exclude={"seed"})
    return json.dumps([spec, row.spec_digest], sort_keys=True)


def _line(rows: list[Row]) -> dict[str, Any]:
    """The table's line of one run identity; `rows` by rising seed."""
    first, seeds = rows[0], len({row.spec.seed for row in rows})
    line: dict[str, Any] = {name: getattr(first.spec, name) for name in IDENTITY}
    for score in SCORES:
        values = [getattr(row.scores, score) for row in rows]
        line[score] = statistics.fmean(values)
        line[f"{score}_std"] = statistics.stdev(values) if len(values) > 1 else float("nan")
    for name in ("wall_s", "env_steps_per_s"):
        line[name] = statistics.fmean(getattr(row, name) for row in rows)
    few = f"{seeds} of at least {MIN_SEEDS} seeds" if seeds < MIN_SEEDS else ""
    return line | {
        "seeds": seeds,
        "spec_digest": first.spec_digest,
        "versions": _versions(rows),
        "command": first.provenance.command,
        "unranked": "smoke run" if first.spec.smoke else few,
    }


def _versions(rows: list[Row]) -> str:
    """Names and versions of what is not in `BENEATH`; versions that differ stand side by side."""
    pairs = {pair for row in rows for pair in row.provenance.versions.items()}
    names = sorted({name for name, _ in pairs} - BENEATH)
    return ", ".join(
        f"{name} {'/'.join(sorted(v for n, v in pairs if n == name))}" for name in names
    )


def _rank(line: dict[str, Any], lines: list[dict[str, Any]]) -> int | None:
    """One more than the number of better lines it competes with; equal scores share a rank."""
    if line["unranked"]:
        return None
    rivals = [other for other in lines if not other["unranked"] and _compete(line, other)]
    return 1 + sum(bool(other["tracked"] > line["tracked"]) for other in rivals)


def _compete(line: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(line[name] == other[name] for name in RANKED_TOGETHER)


def _task_order(task: str) -> tuple[int, str]:
    known = list(PAPER)
    return (known.index(task) if task in known else len(known), task)


def _write(path: Path, text: str) -> None:
    """Write the whole file or none of it: to a neighbour, then renamed."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    neighbour = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        neighbour.write_text(text, encoding="utf-8", newline="\n")
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
