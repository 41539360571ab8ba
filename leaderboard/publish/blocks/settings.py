"""The paper's table: its figures, and its circle at other paces and sizes and with other sticks."""

from collections.abc import Iterator, Mapping

from leaderboard._grid import grid
from leaderboard.paper import PAPER, SETTINGS
from leaderboard.publish.blocks.paper import LEAD
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import listed

COLUMNS: dict[str, tuple[str, dict | None]] = {
    "`contact-centers`": ("circle-settings", {}),
    "varied circles": ("circle-varied-settings", None),
    "`centers-and-lead`": ("circle-varied-lead-settings", LEAD),
}
"""Folders of the circle's transfers by what it was trained with, and what is unusual about the
policies of the other figures."""
REFERENCE, PLAIN = "mujoco built", ("task=circle", "radius=2cm", "pace=1")
"""The world, and the settings of the plain circle."""
Cells = dict[str, dict]
"""Lines of a matrix by what was changed."""


@block
def whole(kept: Kept) -> str:
    """Errors in the paper's figures and settings, beside the paper's."""
    rows = [[name, *map(_errors, cells), _errors(vars(own))] for name, own, *cells in _whole(kept)]
    return grid(["p_err [cm], q_err [deg]", *COLUMNS, "the paper's"], rows)


@block
def below(kept: Kept) -> str:
    """In which rows both errors are at or below the paper's, by observation."""
    found: dict[str, tuple[str, ...]] = dict.fromkeys(COLUMNS, ())
    for name, own, *cells in _whole(kept):
        for column, one in zip(COLUMNS, cells, strict=True):
            if one is not None and all(one[error] <= vars(own)[error] for error in vars(own)):
                found[column] = (*found[column], name.partition(":")[0])
    first, varied, lead = (listed(list(names)) for names in found.values())
    return (
        f"Both errors are at or below the paper's on {first} with `contact-centers` ({varied} with "
        f"varied circles), and on {lead} with `centers-and-lead`."
    )


def _whole(kept: Kept) -> Iterator[tuple]:
    """A row per figure and setting: its name, the paper's errors, and the cells of each column."""
    settings = [_changed(kept, folder) for folder, _ in COLUMNS.values()]
    for task, own in PAPER.items():
        if task == "circle":
            yield task, own, *(cells[""] for cells in settings)
            continue
        made = [made for _, made in COLUMNS.values()]
        yield task, own, *(None if m is None else kept.line(task, **m).cells for m in made)
    for name, setting in SETTINGS.items():
        words = f"{name}: {setting.words}"
        yield words, setting.row, *(cells[setting.change] for cells in settings)


@block
def settings_held(kept: Kept) -> str:
    """What is tracked and held in the paper's figures and settings, and with other sticks."""
    rows = [[name, *map(_fractions, cells)] for name, _, *cells in _whole(kept)]
    found = [_changed(kept, folder) for folder, _ in COLUMNS.values()]
    for change in found[0]:
        if change.startswith("stick="):
            name = f"{change.removeprefix('stick=')} stick"
            rows.append([name, *(_fractions(cells[change]) for cells in found)])
    return grid(["tracked, held", *COLUMNS], rows)


def _changed(kept: Kept, folder: str) -> Cells:
    """The lines of a matrix by what differs from the plain circle."""
    lines = {}
    for line in kept.matrix(folder).to_dict("records"):
        change = line["deploy"].removeprefix(REFERENCE).strip()
        if change or line["task"] == "circle":
            lines[",".join(one for one in change.split(",") if one not in PLAIN)] = line
    return lines


def _errors(line: Mapping[str, float] | None) -> str:
    return "" if line is None else f"{line['p_err_cm']:.2f}, {line['q_err_deg']:.2f}"


def _fractions(line: Mapping[str, float] | None) -> str:
    return "" if line is None else f"{line['tracked']:.2f}, {line['held']:.3f}"
