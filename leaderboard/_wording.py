"""Texts that the Markdown file and the page share."""

import math
from typing import Any

from leaderboard.tables import MIN_SEEDS

MADE_BY = "Made by `bench leaderboard`; not edited by hand."
READING = (
    "Means over seeds and episodes, with the 95 % interval of the stratified bootstrap (seeds are "
    "drawn, then episodes within each) in brackets; IQM is the mean of the middle half of all "
    "episodes. `tracked` ranks: the fraction of all steps with the stick held, the lower "
    "end within 1 cm and the axis within 5 degrees. Rows are ranked together only where task, "
    f"radius, pace, engine, world digest and steps are equal. Under {MIN_SEEDS} seeds there are "
    "values, but neither intervals nor ranks. Intervals from few seeds are too short: they hold "
    "the true mean about 76 times in 100 at 3 seeds, 85 at 5, 90 at 10. ✓ beside the count: the "
    "policies of all its seeds were replayed by `bench verify` and score what their rows say."
)
COMPARING = (
    "How likely a new seed of the first policy tracks better than a new seed of the second, in the "
    "same world with the same budget, over the tasks that both were trained on."
)


def policy_name(cells: dict[str, Any]) -> str:
    """Algorithm, observation, and the worlds drawn in training."""
    drawn = ", randomized" if cells["randomize"] else ""
    spread = f" ({cells['spread']})" if drawn and cells["spread"] != "paper" else ""
    return f"{cells['algo']}, {cells['observation']}{drawn}{spread}{starts(cells)}"


def starts(cells: dict[str, Any]) -> str:
    """The initial states of the training, if they differ from the paper's."""
    width = cells["start_spread"]
    return "" if width == 1 else ", single start" if width == 0 else f", starts x {width:g}"


def figure_name(cells: dict[str, Any]) -> str:
    """Size and pace of the drawn figure."""
    return f"{cells['radius_m'] * 100:g} cm, pace {cells['speed']:g}"


def count(cells: dict[str, Any]) -> str:
    """Seeds times episodes, and a mark where every seed was verified."""
    mark = " ✓" if cells["verified"] == cells["seeds"] else ""
    return f"{cells['seeds']} x {cells['episodes'] / cells['seeds']:g}{mark}"


def value_text(cells: dict[str, Any], score: str, digits: int) -> str:
    """A value; blank if there is none."""
    value = cells[score]
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def interval_text(cells: dict[str, Any], score: str, digits: int) -> str:
    """The interval of a value; blank if there is none."""
    low, high = cells[f"{score}_low"], cells[f"{score}_high"]
    return "" if math.isnan(low) else f"[{low:.{digits}f}, {high:.{digits}f}]"


def with_interval(cells: dict[str, Any], score: str, digits: int) -> str:
    """A value and its interval."""
    return f"{value_text(cells, score, digits)} {interval_text(cells, score, digits)}".strip()
