"""The transfer matrix as Markdown, and texts that it shares with the picture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from leaderboard._grid import grid, plain
from leaderboard._wording import starts
from leaderboard.tables import MIN_SEEDS
from leaderboard.transfer import EPISODES_ALONE, FIGURE, IDENTITY

FLOOR = "noise floor"
READING = (
    "Made by `bench transfer`; not edited by hand. Each cell: mean `tracked` over seeds and "
    "episodes with its 95 % interval, then the retention (deploy over train, from the same initial "
    "states) with its own. The noise floor is the retention of the train world itself from other "
    "initial states: a retention inside its interval is no loss that could be seen."
)
ERRORS = "Fraction held, and mean errors of the lower end and of the axis while it was:"
AGREEING = (
    "How well the mean `tracked` of the policies in a world predicts that in `{reference}`. "
    "Pearson's r with its 95 % interval (1 is best); MMRV, the mean maximum rank violation "
    "(0 is best): what ranking by this world can cost in `tracked` in the reference. Beside them "
    "the noise floor: the reference against itself from other initial states."
)


@dataclass(frozen=True, kw_only=True)
class Panel:
    """The matrix of one kind of policy."""

    shared: dict[str, Any]
    """What its policies have in common."""
    train: list[str]
    """Train worlds, in the order of the deploy worlds, so that own worlds lie on the diagonal."""
    deploy: list[str]
    """Deploy worlds, in order."""
    lines: dict[tuple[str, str], dict[str, Any]]
    """Lines of the matrix by train and deploy world."""

    def any_line(self, train: str) -> dict[str, Any]:
        """A line of a train world; all of them carry its noise floor."""
        return next(line for (name, _), line in self.lines.items() if name == train)


def panels(matrix: pd.DataFrame) -> list[Panel]:
    """The matrix, one panel per kind of policy."""
    found = []
    for key, part in matrix.groupby(list(IDENTITY), sort=False):
        lines = part.to_dict("records")
        deploy = list(dict.fromkeys(line["deploy"] for line in lines))
        train = dict.fromkeys(line["train"] for line in lines)
        found.append(
            Panel(
                shared=dict(zip(IDENTITY, key, strict=True)),
                train=sorted(train, key=[*deploy, *train].index),
                deploy=deploy,
                lines={(line["train"], line["deploy"]): line for line in lines},
            )
        )
    return found


def title(shared: dict[str, Any]) -> str:
    """A kind of policy, in words."""
    smoke = " (smoke)" if shared["smoke"] else ""
    drawn = f", randomized ({shared['spread']})" if shared["randomize"] else ""
    kind = f"{shared['algo']}, {shared['observation']}{drawn}{starts(shared)}"
    policy = f"{kind}, {shared['steps']:,} steps{smoke}"
    return f"{figure(shared)}: {policy}"


def figure(shared: dict[str, Any]) -> str:
    """The task, in words."""
    size = f"{shared['radius_m'] * 100:g} cm, pace {shared['speed']:g}"
    stick = "" if shared["stick"] == "reference" else f", {shared['stick']} stick"
    return f"{shared['task']}, {size}{stick}"


def markdown(
    matrix: pd.DataFrame, agreement: pd.DataFrame, reference: str, notes: Sequence[str]
) -> str:
    """The whole text; `notes` say what is missing and why."""
    parts = ["# Transfer", READING]
    for panel in panels(matrix):
        parts += [f"## {title(panel.shared)}", grid(*cells(panel)), counts(panel)]
        parts += [ERRORS, grid(*error_cells(panel))]
    parts += ["## Rank agreement", AGREEING.format(reference=reference)]
    if agreement.empty:
        parts += [f"None: no policy was deployed in `{reference}` and in another world."]
    else:
        parts += [grid(*agreement_cells(agreement))]
    if notes:
        parts += ["## Left out", "\n".join(f"- {plain(note)}" for note in notes)]
    return "\n\n".join(parts) + "\n"


def interval(line: dict[str, Any], name: str, digits: int = 3) -> str:
    """A value with its interval, as far as known."""
    value, low, high = (line[f"{name}{part}"] for part in ("", "_low", "_high"))
    if math.isnan(value):
        return "-"
    known = "" if math.isnan(low) else f" [{low:.{digits}f}, {high:.{digits}f}]"
    return f"{value:.{digits}f}{known}"


def cells(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Head and rows: `tracked` and retention of every train and deploy world."""
    rows = []
    for train in panel.train:
        lines = [panel.lines.get((train, world)) for world in panel.deploy]
        cells = ["" if line is None else _cell(line) for line in lines]
        rows.append([train, *cells, f"x {interval(panel.any_line(train), 'floor', 2)}"])
    return _upright(["trained in", *panel.deploy, FLOOR], rows)


def _cell(line: dict[str, Any]) -> str:
    return f"{interval(line, 'tracked')}, x {interval(line, 'retention', 2)}"


def error_cells(panel: Panel) -> tuple[list[str], list[list[str]]]:
    """Head and rows: fraction held and errors of every train and deploy world."""
    rows = []
    for train in panel.train:
        lines = [panel.lines.get((train, world)) for world in panel.deploy]
        rows.append([train, *("" if line is None else _errors(line) for line in lines)])
    return _upright(["trained in", *panel.deploy], rows)


def _upright(head: list[str], rows: list[list[str]]) -> tuple[list[str], list[list[str]]]:
    """The table; with a single train world, transposed to a row per deploy world."""
    if len(rows) != 1:
        return head, rows
    (row,) = rows
    title = ["deployed in", f"trained in {row[0]}"]
    return title, [list(pair) for pair in zip(head[1:], row[1:], strict=True)]


def _errors(line: dict[str, Any]) -> str:
    return f"{line['held']:.3f}, {line['p_err_cm']:.2f} cm, {line['q_err_deg']:.2f} deg"


def counts(panel: Panel) -> str:
    """Number of seeds and episodes of a panel."""
    lines = panel.lines.values()
    seeds = sorted({line["seeds"] for line in lines})
    count = " or ".join(map(str, seeds))
    text = f"Seeds: {count}; episodes of each: {max(line['episodes'] for line in lines)}."
    if any(line["interval_over"] == EPISODES_ALONE for line in lines):
        text += f" Under {MIN_SEEDS} seeds the intervals hold for other episodes of these policies,"
        text += " not for other seeds."
    return text


def agreement_cells(agreement: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Head and rows of the rank agreement."""
    rows = []
    for line in agreement.to_dict("records"):
        rows.append(
            [
                figure({name: line[name] for name in FIGURE}),
                FLOOR if line["floor"] else line["world"],
                str(line["policies"]),
                interval(line, "pearson", 2),
                "-" if math.isnan(line["mmrv"]) else f"{line['mmrv']:.3f}",
                line["note"],
            ]
        )
    return ["figure", "world", "policies", "Pearson's r", "MMRV", "note"], rows
