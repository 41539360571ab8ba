"""The leaderboard as Markdown text: a section per task, then what is not ranked and why."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from leaderboard._grid import grid
from leaderboard._wording import (
    COMPARING,
    MADE_BY,
    READING,
    count,
    figure_name,
    policy_name,
    with_interval,
)
from leaderboard.compare import Comparison
from leaderboard.paper import ENGINE, EPISODES, FIGURE, PAPER
from leaderboard.row import Row
from leaderboard.tables import Board

HEAD = (
    *("rank", "engine", "effects, stick", "world", "policy", "figure", "steps", "seeds x episodes"),
    *("tracked", "tracked IQM", "held", "p_err [cm]", "q_err [deg]", "wall [min]"),
)


def markdown(board: Board) -> str:
    """The whole text."""
    lines = [line.cells for line in board.lines]
    parts = [MADE_BY, "# Leaderboard", READING if lines else "No finished run."]
    for task in dict.fromkeys(line["task"] for line in lines):
        parts += _section(task, [line for line in lines if line["task"] == task])
    parts += _comparisons(board.comparisons)
    parts += _unranked([line for line in lines if line["unranked"]])
    parts += _missing(board.missing)
    parts += _problems(board.problems)
    return "\n\n".join(parts) + "\n"


def _section(task: str, lines: list[dict[str, Any]]) -> list[str]:
    cells = [_cells(line) for line in lines]
    if task in PAPER:
        cells.append(_paper_cells(task))
    commands = "\n".join(f"- {_label(line)}: {_made(line)}" for line in lines)
    details = f"<details><summary>Commands</summary>\n\n{commands}\n\n</details>"
    return [f"## {_escape(task)}", _grid(HEAD, cells), details]


def _cells(line: dict[str, Any]) -> tuple[str, ...]:
    return (
        "" if pd.isna(line["rank"]) else str(line["rank"]),
        line["backend"],
        f"{line['effects']}, {line['stick']}",
        line["spec_digest"],
        policy_name(line),
        figure_name(line),
        f"{line['steps']:,}",
        count(line),
        with_interval(line, "tracked", 3),
        with_interval(line, "tracked_iqm", 3),
        with_interval(line, "held", 3),
        with_interval(line, "p_err_cm", 2),
        with_interval(line, "q_err_deg", 2),
        f"{line['wall_s'] / 60:.1f}",
    )


def _paper_cells(task: str) -> tuple[str, ...]:
    paper = PAPER[task]
    setting = (ENGINE, "", "", "", FIGURE, "", f"{EPISODES} episodes")
    errors = (f"{paper.p_err_cm:.2f}", f"{paper.q_err_deg:.2f}")
    return ("paper", *setting, "not reported", "", "not reported", *errors, "")


def _comparisons(comparisons: Sequence[Comparison]) -> list[str]:
    if not comparisons:
        return []
    head = ("engine", "world", "figure", "steps", "first", "second", "tasks", "seeds", "P(first)")
    cells = [_comparison_cells(comparison) for comparison in comparisons]
    return ["## Probability of improvement", COMPARING, _grid(head, cells)]


def _comparison_cells(comparison: Comparison) -> tuple[str, ...]:
    first, found = comparison.first, comparison.probability
    return (
        first["backend"],
        first["spec_digest"],
        figure_name(first),
        f"{first['steps']:,}",
        policy_name(first),
        policy_name(comparison.second),
        ", ".join(comparison.tasks),
        "{} against {}".format(*comparison.seeds),
        f"{found.value:.2f} [{found.low:.2f}, {found.high:.2f}]",
    )


def _label(line: dict[str, Any]) -> str:
    world = f"{line['backend']}, {line['effects']}, {line['stick']}"
    return _escape(f"{world}, {policy_name(line)}, {figure_name(line)}, {line['steps']:,} steps")


def _made(line: dict[str, Any]) -> str:
    speed = f"{line['wall_s'] / 60:.1f} min a seed, {line['env_steps_per_s']:,.0f} steps/s"
    return f"{_code(line['command'])} ({speed}; {_escape(line['versions'])})"


def _unranked(lines: list[dict[str, Any]]) -> list[str]:
    if not lines:
        return []
    items = [f"- {_escape(line['task'])}, {_label(line)}: {line['unranked']}" for line in lines]
    return ["## Rows without a rank", "\n".join(items)]


def _missing(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    counts = sorted(Counter(row.status for row in rows).items())
    text = ", ".join(f"{count} {status}" for status, count in counts)
    cells = sorted(_missing_cells(row) for row in rows)
    head = ("task", "engine", "policy", "seed", "run", "status", "reason")
    return ["## Runs not done", f"{len(rows)}: {text}.", _grid(head, cells)]


def _missing_cells(row: Row) -> tuple[str, ...]:
    spec = row.spec
    policy = policy_name(spec.model_dump())
    seed = str(spec.seed)
    return (spec.task, spec.backend, policy, seed, row.digest, row.status, row.reason)


def _problems(problems: Sequence[str]) -> list[str]:
    if not problems:
        return []
    items = "\n".join(f"- {_escape(problem)}" for problem in problems)
    return ["## Problems", f"{len(problems)}:", items]


def _grid(head: Sequence[str], cells: Iterable[Sequence[str]]) -> str:
    return grid(head, [[_shown(cell) for cell in row] for row in cells])


def _escape(text: str) -> str:
    """Text that Markdown shows as it is, on one line, also inside a table."""
    return _shown(text).replace("|", "\\|")


def _shown(text: str) -> str:
    """The same outside of tables, where a bar means nothing."""
    for mark in ("\\", "<", "`", "*"):
        text = text.replace(mark, "\\" + mark)
    return " ".join(text.split())


def _code(text: str) -> str:
    """Text as inline code, also where it holds backticks."""
    text = " ".join(text.split())
    return f"`` {text} ``" if "`" in text else f"`{text}`"
