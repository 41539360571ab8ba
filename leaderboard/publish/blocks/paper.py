"""The paper's four figures on the reference."""

from typing import Any

from leaderboard._grid import grid
from leaderboard._wording import count, with_interval
from leaderboard.paper import PAPER
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import million, shown
from leaderboard.row import Row

LEAD = {
    "observation": "centers-and-lead",
    "algo": "sb3-ppo rollout_steps=32 gamma=0.97 anneal=0.4 critic=state",
    "steps": 1_000_000,
}
"""What is unusual about the policies that also see how far the targets lead."""
VARIED = "circle-varied"
ERRORS = ("p_err [cm]", "q_err [deg]")


@block
def paper(kept: Kept) -> str:
    """The errors beside the paper's, short enough for a front page."""
    head = ("figure", "tracked", "p_err [cm]", "the paper's", "q_err [deg]", "the paper's")
    return grid(head, [_short(task, kept.line(task).cells) for task in PAPER])


@block
def figures(kept: Kept) -> str:
    """All scores of the four figures."""
    head = (
        *("figure", "seeds x episodes", "tracked", "hold-still's", "held", "p_err [cm]"),
        *("the paper's", "q_err [deg]", "the paper's", "minutes a seed"),
    )
    return grid(head, [_long(kept, task) for task in PAPER])


@block
def search(kept: Kept) -> str:
    """Single runs with other learners and hyperparameters than the table's, and varied circles."""
    head = ("task", "engine", "learner", "sees", "steps", "seed", "tracked", "held", *ERRORS)
    anyhow = {"backend": ..., "algo": ..., "steps": ..., "observation": ...}
    found = [
        (line.cells, row)
        for task in (*PAPER, VARIED)
        for line in kept.lines(task, radius_m=..., speed=..., **anyhow)
        for row in line.rows
        if row.spec.overrides and (task == VARIED or line.cells["algo"] != LEAD["algo"])
    ]
    return grid(head, [_single(cells, row) for cells, row in found])


def _single(cells: dict[str, Any], row: Row) -> tuple[str, ...]:
    scores = row.scores
    assert scores is not None  # the board's rows are done
    return (
        *(cells["task"], shown(cells["backend"])),
        *(f"`{cells['algo']}`", f"`{cells['observation']}`"),
        *(million(cells["steps"]), str(row.spec.seed)),
        *(f"{scores.tracked:.2f}", f"{scores.held:.3f}"),
        *(f"{scores.p_err_cm:.2f}", f"{scores.q_err_deg:.2f}"),
    )


def _short(task: str, cells: dict[str, Any]) -> tuple[str, ...]:
    return (task, with_interval(cells, "tracked", 2), *_errors(task, cells))


def _long(kept: Kept, task: str) -> tuple[str, ...]:
    cells = kept.line(task).cells
    still = kept.line(task, algo="hold-still", steps=0, randomize=False).cells
    return (
        task,
        count(cells),
        with_interval(cells, "tracked", 3),
        f"{still['tracked']:.3f}",
        f"{cells['held']:.3f}",
        *_errors(task, cells),
        f"{cells['wall_s'] / 60:.0f}",
    )


def _errors(task: str, cells: dict[str, Any]) -> tuple[str, ...]:
    """Both errors, each with the paper's."""
    measured = PAPER[task]
    return (
        with_interval(cells, "p_err_cm", 2),
        f"{measured.p_err_cm:.2f}",
        with_interval(cells, "q_err_deg", 2),
        f"{measured.q_err_deg:.2f}",
    )
