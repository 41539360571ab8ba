"""The circle's policies where they were not trained: other paces, sizes and sticks."""

from leaderboard._grid import grid
from leaderboard.paper import PAPER, SETTINGS
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block

COLUMNS = {
    "`circle`": "circle-settings",
    "`circle-mixed-entry`": "circle-entry-settings",
    "`circle`, lead": "circle-lead-settings",
    "`circle-mixed-entry`, lead": "circle-entry-lead-settings",
}
"""Transfer folders by what their policies were trained on and with."""
REFERENCE, OWN_TASK = "mujoco built", "task=circle"
TRAINED = "as trained: 2 cm, pi rad/s"
Cells = dict[str, dict]
"""Lines of a matrix by what was changed."""


@block
def settings(kept: Kept) -> str:
    """Errors in the paper's settings, beside the paper's."""
    changes = {TRAINED: ("", PAPER["circle"])}
    changes |= {f"{k}: {s.words}": (s.change, s.row) for k, s in SETTINGS.items()}
    found = [_changed(kept, folder) for folder in COLUMNS.values()]
    rows = [
        [name, *(_errors(cells[change]) for cells in found), f"{p.p_err_cm:.2f}, {p.q_err_deg:.2f}"]
        for name, (change, p) in changes.items()
    ]
    return grid(["p_err [cm], q_err [deg]", *COLUMNS, "the paper's"], rows)


@block
def settings_held(kept: Kept) -> str:
    """What is tracked and held in the paper's settings and with other sticks."""
    found = [_changed(kept, folder) for folder in COLUMNS.values()]
    names = {"": TRAINED} | {s.change: f"{k}: {s.words}" for k, s in SETTINGS.items()}
    rows = [
        [names.get(change, _stick(change)), *(_fractions(cells[change]) for cells in found)]
        for change in found[0]
    ]
    return grid(["tracked, held", *COLUMNS], rows)


def _changed(kept: Kept, folder: str) -> Cells:
    """The lines of a matrix by their settings; the circle's own counts for no change."""
    lines = {}
    for line in kept.matrix(folder).to_dict("records"):
        change = line["deploy"].removeprefix(REFERENCE).strip()
        lines[change.removeprefix(OWN_TASK).lstrip(",")] = line
    return lines


def _stick(change: str) -> str:
    return f"{change.removeprefix('stick=')} stick"


def _errors(line: dict) -> str:
    return f"{line['p_err_cm']:.2f}, {line['q_err_deg']:.2f}"


def _fractions(line: dict) -> str:
    return f"{line['tracked']:.2f}, {line['held']:.3f}"
