"""The paper's four figures on the reference."""

from typing import Any

from leaderboard._grid import grid
from leaderboard._wording import count, with_interval
from leaderboard.paper import PAPER
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import listed

LEAD = "centers-and-lead"


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
def nearer(kept: Kept) -> str:
    """On which figures the errors are below the paper's."""
    lines = {task: kept.line(task).cells for task in PAPER}
    lower = [task for task in PAPER if lines[task]["p_err_cm"] < PAPER[task].p_err_cm]
    axis = [task for task in PAPER if lines[task]["q_err_deg"] < PAPER[task].q_err_deg]
    return (
        f"The lower end is nearer to its reference than in the paper on {listed(lower)}, and the "
        f"axis on {listed(axis)}."
    )


@block
def lead(kept: Kept) -> str:
    """The figures with the observation that also shows how far the targets lead."""
    head = ("figure", "tracked", "held", "p_err [cm]", "the paper's", "q_err [deg]", "the paper's")
    rows = []
    for task in ("line", "circle", "eight"):
        cells = kept.line(task, observation=LEAD).cells
        name, tracked, *errors = _short(task, cells)
        rows.append((name, tracked, f"{cells['held']:.3f}", *errors))
    return grid(head, rows)


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
