"""The paper's figures on the reference, and its circle at other paces and sizes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from leaderboard._grid import grid
from leaderboard._wording import count, with_interval
from leaderboard.paper import PAPER, SETTINGS, PaperRow
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import listed, million, shown

STEPS = {"line": 2_000_000, "spiral": 1_000_000, "eight": 1_000_000, "circle-varied": 4_000_000}
"""How long the policies of the table were trained."""
REFERENCE, PLAIN = "mujoco built", ("task=circle", "radius=2cm", "pace=1")
"""The world, and the settings of the plain circle."""
ERRORS = ("p_err [cm]", "q_err [deg]")
Scores = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Column:
    """What policies with one observation have in common."""

    algo: str
    circles: str
    """The folder of the circle's transfers."""


COLUMNS = {
    "contact-centers": Column(
        algo="sb3-ppo epochs=8 gamma=0.98 anneal=0.4 critic=state",
        circles="circle-varied-settings",
    ),
    "centers-and-lead": Column(
        algo="sb3-ppo rollout_steps=32 gamma=0.97 anneal=0.4 critic=state",
        circles="circle-varied-lead-settings",
    ),
}
"""By observation."""


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
    table = list(_table(kept))
    for words, own, all_scores in table:
        for names, scores in zip(found.values(), all_scores, strict=True):
            if all(scores[error] <= limit for error, limit in vars(own).items()):
                names.append(words.partition(":")[0])
    said = [
        f"on {'all rows' if len(names) == len(table) else listed(names)} with `{column}`"
        for column, names in found.items()
    ]
    return f"Both errors are at or below the paper's {listed(said)}."


@block
def settings_held(kept: Kept) -> str:
    """What is tracked and held in the paper's figures and settings, and with other sticks."""
    rows = [(words, *map(_fractions, scores)) for words, _, scores in _table(kept)]
    circles = [_circles(kept, one.circles) for one in COLUMNS.values()]
    for change in circles[0]:
        if change.startswith("stick="):
            name = f"{change.removeprefix('stick=')} stick"
            rows.append((name, *(_fractions(cells[change]) for cells in circles)))
    return grid(["tracked, held", *(f"`{name}`" for name in COLUMNS)], rows)


def _table(kept: Kept) -> Iterator[tuple[str, PaperRow, list[Scores]]]:
    """A row per figure and setting: its name, the paper's errors, and the scores by observation."""
    circles = [_circles(kept, one.circles) for one in COLUMNS.values()]
    for task, own in PAPER.items():
        if task == "circle":
            yield task, own, [cells[""] for cells in circles]
        else:
            yield task, own, [_trained(kept, task, name) for name in COLUMNS]
    for name, setting in SETTINGS.items():
        yield f"{name}: {setting.words}", setting.row, [cells[setting.change] for cells in circles]


def _trained(kept: Kept, task: str, observation: str) -> Scores:
    algo, steps = COLUMNS[observation].algo, STEPS[task]
    return kept.line(task, observation=observation, algo=algo, steps=steps).cells


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
    """Other learners and hyperparameters than the table's."""
    head = ("task", "engine", "learner", "sees", "steps", "seeds", "tracked", "held", *ERRORS)
    anyhow = {"backend": ..., "algo": ..., "steps": ..., "observation": ...}
    found = [
        line.cells
        for task in ("circle", *STEPS)
        for line in kept.lines(task, radius_m=..., speed=..., **anyhow)
        if line.rows[0].spec.overrides and not _is_in_table(line.cells)
    ]
    return grid(head, [_tried(cells) for cells in found])


def _is_in_table(cells: Scores) -> bool:
    column, steps = COLUMNS.get(cells["observation"]), STEPS.get(cells["task"])
    return column is not None and (column.algo, steps) == (cells["algo"], cells["steps"])


def _tried(cells: Scores) -> tuple[str, ...]:
    return (
        *(cells["task"], shown(cells["backend"])),
        *(f"`{cells['algo']}`", f"`{cells['observation']}`"),
        *(million(cells["steps"]), str(cells["seeds"])),
        *(f"{cells['tracked']:.2f}", f"{cells['held']:.3f}"),
        *(f"{cells['p_err_cm']:.2f}", f"{cells['q_err_deg']:.2f}"),
    )
