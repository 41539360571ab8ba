"""The blind check of the diagnosis: the latest scores."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

from leaderboard._grid import grid
from leaderboard.blind.figures import BY_NAME
from leaderboard.blind.score import Counted, Kind, Score
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import SHOWN, in_order, listed, percent, shown

FRONT = ("top1", "pairs_exact", "none_accused", "unknown_recall")
"""Figures of the front page."""
NAMED = ("top1", "top3", "joint_right", "pairs_exact", "pairs_one", "spurious_second")
REFUSED = (
    *("none_accused", "none_false_alarm", "unknown_recall"),
    *("interval_coverage", "magnitude_error_median", "cpu_s_median"),
)
FINGER, HELD = "finger", "held"
MOST_SPLIT = 4
"""More sides than these share a row."""
RIGS = {
    FINGER: "finger",
    HELD: "stick in the hand",
    "hand": "hand in free air",
    "arm1+arm2": "arms of 1 and 2 joints",
    "arm2+arm3+arm6": "arms of 2 to 6 joints",
}
"""What is judged, in words."""


@block
def blind(kept: Kept) -> str:
    """By real side, short enough for a front page."""
    return _table(_rows(kept, lambda kind: not kind.healthy), FRONT)


@block
def blind_named(kept: Kept) -> str:
    """What is named where something is hidden."""
    return _table(_rows(kept), NAMED)


@block
def blind_refused(kept: Kept) -> str:
    """What is not named where it should not be, and how large effects are said to be."""
    return _table(_rows(kept), REFUSED)


@block
def blind_meanings(kept: Kept) -> str:
    """The columns, in words."""
    shown = (BY_NAME[name] for name in (*NAMED, *REFUSED))
    return "\n".join(f"- *{figure.head}*: {figure.meaning}" for figure in shown)


@block
def blind_baselines(kept: Kept) -> str:
    """The diagnosis beside simpler methods on the same cases."""
    head = ("set", "method", "effect right", "nothing hidden, not `none`", "pair right")
    rows = []
    for _, scores in _kinds(kept, lambda kind: _split(kind) and kind.modes == "all"):
        for name, score in list(scores.items())[-1:]:
            for line in score.tables["baselines"]:
                shown = (line.get(key) for key in ("top1", "none_false_alarm", "pairs_exact"))
                cells = ("" if value is None else f"{value:.2f}" for value in shown)
                rows.append([name, line["method"], *cells])
    return grid(head, rows)


@block
def blind_confidence(kept: Kept) -> str:
    """How often verdicts of a confidence are right, over all sets of all kinds of cases."""
    bins: dict[tuple[float, float], list[dict]] = {}
    for _, scores in _kinds(kept, lambda kind: kind.modes == "all"):
        for score in scores.values():
            for line in score.tables["reliability"]:
                if line["count"]:
                    bins.setdefault((line["from"], line["to"]), []).append(line)
    rows = []
    for low, high in sorted(bins):
        lines = bins[low, high]
        total = sum(line["count"] for line in lines)
        mean = sum(line["confidence"] * line["count"] for line in lines) / total
        right = sum(round(line["value"] * line["count"]) for line in lines)
        rows.append([f"{low:g} to {high:g}", f"{mean:.2f}", f"{right / total:.2f}", str(total)])
    return grid(("confidence", "its mean", "share right", "verdicts"), rows)


@block
def blind_sets(kept: Kept) -> str:
    """How many sets and cases there are."""
    lines = kept.blind_sets
    blind_ones = [line for line in lines if line.blind]
    cases = sum(line.cases for line in blind_ones)
    return (
        f"So far {len(blind_ones)} sets with {cases:,} cases were solved once, by a solver that "
        f"was frozen before it saw them; {len(lines) - len(blind_ones)} more are for tuning."
    )


@block
def blind_latest(kept: Kept) -> str:
    """The sets behind the tables."""
    shown = {name for scores in kept.blind_scores.values() for name in scores}
    rows = [
        [f"`{line.name}`", f"{line.date:%Y-%m-%d}", f"`{line.commit}`", str(line.cases)]
        for line in reversed(kept.blind_sets)
        if line.name in shown
    ]
    return grid(("set", "published", "commit", "cases"), rows)


class _Row(NamedTuple):
    """A real side, or a kind of set."""

    label: str
    give: Callable[[str], list[Counted]]
    """A figure by its name, one for each set."""


def _rows(kept: Kept, wanted: Callable[[Kind], bool] = lambda kind: True) -> Iterator[_Row]:
    for kind, scores in _kinds(kept, lambda kind: kind.modes == "all" and wanted(kind)):
        sets = list(scores.values())
        if _split(kind):
            yield from (_of_side(sets, kind, side) for side in in_order(kind.sides))
        else:
            yield _Row(_label(kind), partial(_of_all, sets))


def _table(rows: Iterable[_Row], figures: Sequence[str]) -> str:
    """A row per side, and what is wanted."""
    head = ("real side", *(BY_NAME[name].head for name in figures))
    lines = [[row.label, *(_shown(name, row.give(name)) for name in figures)] for row in rows]
    return grid(head, [*lines, ["wanted", *(BY_NAME[name].wanted for name in figures)]])


def _of_side(sets: list[Score], kind: Kind, side: str) -> _Row:
    label = f"{RIGS[kind.rig]}, {shown(side)}"
    return _Row(label, lambda name: [score.of_side(side, name) for score in sets])


def _of_all(sets: list[Score], name: str) -> list[Counted]:
    return [score.figure(name) for score in sets]


def _kinds(kept: Kept, wanted: Callable[[Kind], bool]) -> Iterator[tuple[Kind, dict[str, Score]]]:
    """Kinds of sets: joints before the held stick, those without healthy logs first."""
    places = {side: number for number, side in enumerate(in_order(SHOWN))}

    def place(kind: Kind) -> tuple:
        sides = sorted(places.get(side, len(places)) for side in kind.sides)
        return kind.rig == HELD, kind.healthy, sides, kind

    order = sorted(kept.blind_scores, key=place)
    yield from ((kind, kept.blind_scores[kind]) for kind in order if wanted(kind))


def _split(kind: Kind) -> bool:
    """Whether the sides of a kind are shown one by one."""
    return kind.rig == FINGER and not kind.healthy and 1 < len(kind.sides) <= MOST_SPLIT


def _label(kind: Kind) -> str:
    """What is judged, by which laws, and with what beside."""
    what = RIGS.get(kind.rig, kind.rig)
    if kind.rig != HELD:
        laws = listed([shown(side) for side in in_order(kind.sides)])
        what += f", {len(kind.sides)} drive laws" if len(kind.sides) > MOST_SPLIT else f", {laws}"
    return what + (", healthy logs" if kind.healthy else "")


def _shown(name: str, found: list[Counted]) -> str:
    """A figure of one or more sets: a share pooled, medians side by side."""
    figure = BY_NAME[name]
    if not figure.median:
        return _pooled(found)
    values = [counted.value for counted in found if counted.value is not None]
    if figure.percent:
        return ", ".join(percent(value) for value in values)
    return ", ".join(f"{value:.3g}" for value in values)


def _pooled(found: list[Counted]) -> str:
    total = sum(counted.count for counted in found)
    return f"{sum(counted.hits for counted in found)} of {total}" if total else ""
