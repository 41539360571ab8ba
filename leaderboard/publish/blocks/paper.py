"""The paper's four figures on the reference."""

from typing import Any

from leaderboard._grid import grid
from leaderboard._wording import count, with_interval
from leaderboard.paper import PAPER
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import million, shown
from leaderboard.row import Row

LEAD = "centers-and-lead"
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
def lead(kept: Kept) -> str:
    """The figures with the observation that also shows how far the targets lead."""
    head = ("figure", "tracked", "held", "p_err [cm]", "the paper's", "q_err [deg]", "the paper's")
    rows = []
    for task in PAPER:
        cells = kept.line(task, observation=LEAD).cells
        name, tracked, *errors = _short(task, cells)
        rows.append((name, tracked, f"{cells['held']:.3f}", *errors))
    return grid(head, rows)


@block
def search(kept: Kept) -> str:
    """Single runs with other learners and hyperparameters than the table's."""
    head = ("figure", "engine", "learner", "steps", "seed", *("tracked", "held"), *ERRORS)
    found = [
        (line.cells, row)
        for task in PAPER
        for line in kept.lines(task, backend=..., algo=..., steps=...)
        for row in line.rows
        if row.spec.overrides
    ]
    return grid(head, [_single(cells, row) for cells, row in found])


@block
def large_said(kept: Kept) -> str:
    """What training on the large circle reaches, from the beginning and from smaller ones."""
    large = {"observation": LEAD, "radius_m": 0.03, "steps": 1_000_000}
    new = kept.line("circle", **large)
    (onward,) = (
        line for line in kept.lines("circle", **large, algo=...) if line.rows[0].spec.start_sha256
    )
    return (
        f"A new policy that is trained on the large circle itself, with `{LEAD}` for "
        f"{million(new.cells['steps'])} steps ({len(new.rows)} seed), reaches {_pair(new.cells)} "
        f"there. One that goes on there after mixed entry, for as many more, reaches "
        f"{_pair(onward.cells)}."
    )


@block
def smaller_updates_said(kept: Kept) -> str:
    """What smaller updates reach on varied circles as they are drawn, beside the same seed."""
    varied = {"observation": LEAD, "radius_m": 0.03, "speed": 1.5, "steps": 5_000_000}
    runs = kept.lines("circle-varied", **varied, algo=...)
    rows = [row for line in runs for row in line.rows if row.spec.seed == 2]
    usual, small = sorted(rows, key=lambda row: len(row.spec.overrides))
    scores = [_pair(vars(row.scores)) for row in (small, usual)]
    updates = f"`target_kl={small.spec.overrides['target_kl']}`"
    return (
        f"Smaller updates ({updates}) are no remedy: with seed 2 they reach {scores[0]} on varied "
        f"circles as these are drawn, in place of {scores[1]}."
    )


def _pair(cells: dict[str, Any]) -> str:
    return f"{cells['p_err_cm']:.2f} cm and {cells['q_err_deg']:.2f} deg"


def _single(cells: dict[str, Any], row: Row) -> tuple[str, ...]:
    scores = row.scores
    assert scores is not None  # the board's rows are done
    return (
        *(cells["task"], shown(cells["backend"]), f"`{cells['algo']}`"),
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
