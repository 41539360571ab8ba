"""The paper's figures on the reference, and its circle at other paces and sizes."""

from collections.abc import Iterator, Mapping
from typing import Any

from leaderboard._grid import grid
from leaderboard._wording import count, with_interval
from leaderboard.paper import PAPER, SETTINGS, PaperRow
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import listed, million, shown
from leaderboard.row import Row

COLUMNS = {
    "contact-centers": "circle-varied-settings",
    "centers-and-lead": "circle-varied-lead-settings",
}
"""The circle's transfers, by what their policies see."""
ALGO = "sb3-ppo rollout_steps=32 gamma=0.97 anneal=0.4 critic=state"
STEPS = {"line": 2_000_000, "spiral": 1_000_000, "eight": 1_000_000}
"""How the policies of all rows were trained, and for how long those that do not draw circles."""
REFERENCE, PLAIN = "mujoco built", ("task=circle", "radius=2cm", "pace=1")
"""The world, and the settings of the plain circle."""
VARIED = "circle-varied"
ERRORS = ("p_err [cm]", "q_err [deg]")
Scores = Mapping[str, Any]


@block
def paper(kept: Kept) -> str:
    """The errors with the paper's observation beside the paper's, short enough for a front page."""
    head = ("figure", "tracked", "p_err [cm]", "the paper's", "q_err [deg]", "the paper's")
    rows = [
        (
            *(task, with_interval(dict(scores), "tracked", 2)),
            *(f"{scores['p_err_cm']:.2f}", f"{own.p_err_cm:.2f}"),
            *(f"{scores['q_err_deg']:.2f}", f"{own.q_err_deg:.2f}"),
        )
        for task, own, (scores, *_) in _table(kept)
        if task in PAPER
    ]
    return grid(head, rows)


@block
def whole(kept: Kept) -> str:
    """Errors in the paper's figures and settings, beside the paper's."""
    head = ("p_err [cm], q_err [deg]", *(f"`{name}`" for name in COLUMNS), "the paper's")
    return grid(head, [(name, *map(_errors, (*s, vars(own)))) for name, own, s in _table(kept)])


@block
def below(kept: Kept) -> str:
    """In which rows both errors are at or below the paper's, by observation."""
    found: dict[str, list[str]] = {name: [] for name in COLUMNS}
    for words, own, all_scores in _table(kept):
        for names, scores in zip(found.values(), all_scores, strict=True):
            if all(scores[error] <= limit for error, limit in vars(own).items()):
                names.append(words.partition(":")[0])
    said = [f"on {listed(names)} with `{column}`" for column, names in found.items()]
    return f"Both errors are at or below the paper's {listed(said)}."


@block
def settings_held(kept: Kept) -> str:
    """What is tracked and held in the paper's figures and settings, and with other sticks."""
    rows = [(words, *map(_fractions, scores)) for words, _, scores in _table(kept)]
    circles = [_circles(kept, folder) for folder in COLUMNS.values()]
    for change in circles[0]:
        if change.startswith("stick="):
            name = f"{change.removeprefix('stick=')} stick"
            rows.append((name, *(_fractions(cells[change]) for cells in circles)))
    return grid(["tracked, held", *(f"`{name}`" for name in COLUMNS)], rows)


def _table(kept: Kept) -> Iterator[tuple[str, PaperRow, list[Scores]]]:
    """A row per figure and setting: its name, the paper's errors, and the scores by observation."""
    circles = [_circles(kept, folder) for folder in COLUMNS.values()]
    for task, own in PAPER.items():
        if task == "circle":
            yield task, own, [cells[""] for cells in circles]
        else:
            made = {"algo": ALGO, "steps": STEPS[task]}
            yield task, own, [kept.line(task, observation=o, **made).cells for o in COLUMNS]
    for name, setting in SETTINGS.items():
        yield f"{name}: {setting.words}", setting.row, [cells[setting.change] for cells in circles]


def _circles(kept: Kept, folder: str) -> dict[str, Scores]:
    """The lines of a matrix by what differs from the plain circle."""
    lines = {}
    for line in kept.matrix(folder).to_dict("records"):
        change = line["deploy"].removeprefix(REFERENCE).strip()
        if change or line["task"] == "circle":
            lines[",".join(one for one in change.split(",") if one not in PLAIN)] = line
    return lines


def _errors(line: Mapping[str, float]) -> str:
    return f"{line['p_err_cm']:.2f}, {line['q_err_deg']:.2f}"


def _fractions(line: Mapping[str, float]) -> str:
    return f"{line['tracked']:.2f}, {line['held']:.3f}"


@block
def figures(kept: Kept) -> str:
    """All scores of the four figures with the usual hyperparameters."""
    head = ("figure", "seeds x episodes", "tracked", "hold-still's", "held", *ERRORS)
    return grid((*head, "minutes a seed"), [_long(kept, task) for task in PAPER])


def _long(kept: Kept, task: str) -> tuple[str, ...]:
    cells = kept.line(task).cells
    still = kept.line(task, algo="hold-still", steps=0, randomize=False).cells
    return (
        task,
        count(cells),
        with_interval(cells, "tracked", 3),
        f"{still['tracked']:.3f}",
        f"{cells['held']:.3f}",
        with_interval(cells, "p_err_cm", 2),
        with_interval(cells, "q_err_deg", 2),
        f"{cells['wall_s'] / 60:.0f}",
    )


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
        if row.spec.overrides
        and (line.cells["algo"] != ALGO or line.cells["steps"] != STEPS.get(task))
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
