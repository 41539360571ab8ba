"""The history of the blind sets: one line per set, in the order of their dates."""

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from leaderboard.blind.figures import FIGURES
from leaderboard.blind.score import Counted, Kind, Score

HISTORY_FILE, SCORES = "history.csv", "scores"
SET = ("name", "date", "commit", "rig", "sides", "modes", "healthy", "cases", "blind")
COLUMNS = (*SET, *(f"{figure.name}{part}" for figure in FIGURES for part in ("", "_n")))
DATE = "%Y-%m-%d %H:%M"


@dataclass(frozen=True, kw_only=True)
class Line:
    """One set and what was scored on it."""

    name: str
    """Its own name, which no other set has."""
    date: datetime
    """When its score was published."""
    commit: str
    """The commit that published it."""
    kind: Kind
    healthy: int
    """Healthy logs of every real side that the solver was given."""
    cases: int
    blind: bool
    """Whether the solver was frozen before the set was drawn; else the set is for tuning."""
    figures: dict[str, Counted]

    @property
    def content(self) -> tuple:
        """What no two sets have in common."""
        return (self.kind, self.healthy, self.cases, tuple(sorted(self.figures.items())))


def line_of(score: Score, name: str, date: datetime, commit: str) -> Line:
    """What the history keeps of a score."""
    return Line(
        name=name,
        date=date,
        commit=commit,
        kind=score.kind,
        healthy=score.healthy,
        cases=score.cases,
        blind=score.frozen,
        figures={figure.name: _rounded(score.figure(figure.name)) for figure in FIGURES},
    )


def read_history(folder: Path) -> list[Line]:
    """All sets, oldest first."""
    with (folder / HISTORY_FILE).open(encoding="utf-8", newline="") as file:
        return [_line(row) for row in csv.DictReader(file)]


def history_text(lines: Iterable[Line]) -> str:
    """The history as CSV text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in sorted(lines, key=lambda line: (line.date, line.name)):
        writer.writerow(_cells(line))
    return text.getvalue()


def _cells(line: Line) -> list[object]:
    kind = line.kind
    figures = [
        cell
        for figure in FIGURES
        for cell in (_number(line.figures[figure.name].value), line.figures[figure.name].count)
    ]
    return [
        *(line.name, line.date.strftime(DATE), line.commit, kind.rig, "+".join(kind.sides)),
        *(kind.modes, line.healthy, line.cases, "yes" if line.blind else "no", *figures),
    ]


def _line(row: dict[str, str]) -> Line:
    kind = Kind(row["rig"], tuple(row["sides"].split("+")), row["modes"], row["healthy"] != "0")
    return Line(
        name=row["name"],
        date=datetime.strptime(row["date"], DATE),
        commit=row["commit"],
        kind=kind,
        healthy=int(row["healthy"]),
        cases=int(row["cases"]),
        blind=row["blind"] == "yes",
        figures={
            figure.name: Counted(
                float(row[figure.name]) if row[figure.name] else None,
                int(row[f"{figure.name}_n"]),
            )
            for figure in FIGURES
        },
    )


def _rounded(counted: Counted) -> Counted:
    """As the file holds it."""
    text = _number(counted.value)
    return Counted(float(text) if text else None, counted.count)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
