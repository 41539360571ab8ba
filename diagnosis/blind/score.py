"""Score blind sets: open the answers, compare the results with them, write the tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from diagnosis.blind import judged, tables
from diagnosis.blind.binding import SEAL, checked
from diagnosis.blind.files import Answers, BlindSet, open_answers, write_json
from diagnosis.blind.measures import MEASURES, Figure, figures
from diagnosis.blind.oracle import DETECTABLE_NATS, Oracle

Consult = Callable[[BlindSet, Answers], list[Oracle]]
"""Asks the oracle about all cases of a set, in order, possibly on several cores."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """Scored sets."""

    figures: dict[str, Figure]
    frozen: bool
    """Whether all results are from the solver that their set was committed to."""
    replayed: int
    """Number of cases that were solved again, with the same result."""
    solvers_tried: int
    """Number of solver versions that were run on these sets."""
    healthy: int
    """Number of healthy logs per plant that the solver was given."""
    tables: dict[str, pd.DataFrame]

    def plain(self) -> dict:
        """As JSON: figures as plain numbers, then counts and intervals, then tables."""
        return {
            "cases": len(self.tables["cases"]),
            **{name: figure.value for name, figure in self.figures.items()},
            "frozen": self.frozen,
            "replayed": self.replayed,
            "seal": list(SEAL),
            "solvers_tried": self.solvers_tried,
            "healthy": self.healthy,
            "detectable_nats": DETECTABLE_NATS,
            "intervals": {
                name: {"low": f.low, "high": f.high, "count": f.count}
                for name, f in self.figures.items()
            },
            "tables": {name: _records(table) for name, table in self.tables.items()},
        }


def score(sets: Sequence[tuple[BlindSet, Path]], consult: Consult, replayed: int = 0) -> Score:
    """The score of sets and their answers together; their cases are numbered through.

    Raises BlindError for wrong answers, unfinished or foreign results.
    """
    rows: list[dict] = []
    faults: list[dict] = []
    healthy = set[int]()
    for blind, answers in sets:
        opened, results = open_answers(answers, blind.commitment()), checked(blind)
        given = int(opened.settings.get("healthy", 0))
        healthy.add(given)
        first = len(rows)
        for case, oracle in zip(opened.cases, consult(blind, opened), strict=True):
            said, case = results[case.number], replace(case, number=first + case.number)
            frozen = said["solver_sha256"] == blind.commitment().solver_sha256
            row = judged.case_row(case, said, oracle, given)
            rows.append(row | {"frozen": frozen})
            faults += judged.fault_rows(case, said, oracle)
    by_case, by_fault = judged.frames(rows, faults)
    return Score(
        figures=figures(by_case, by_fault),
        frozen=bool(by_case["frozen"].all()),
        replayed=replayed,
        solvers_tried=len({t["solver_sha256"] for blind, _ in sets for t in blind.tried()}),
        healthy=max(healthy),
        tables={
            "cases": by_case.drop(columns=["wrong", "says_none", "frozen"]),
            "groups": tables.by_group(by_case, by_fault),
            "confusion": tables.confusion(by_case),
            "effects": tables.by_effect(by_fault),
            "reliability": tables.reliability(by_case),
            "confidence": tables.confidence(by_case),
            "baselines": tables.baselines(by_case, by_fault),
        },
    )


def write(found: Score, folder: Path) -> list[Path]:
    """Write score.json, score.md and one CSV per table."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "score.json", found.plain())
    (folder / "score.md").write_text(markdown(found))
    headline(found).to_csv(folder / "headline.csv", index=False)
    for name, table in found.tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    files = ["score.json", "score.md", "headline.csv", *(f"{n}.csv" for n in found.tables)]
    return [folder / name for name in files]


def headline(found: Score) -> pd.DataFrame:
    """A row per figure."""
    rows = [
        {"figure": m.name, **vars(found.figures[m.name]), "meaning": m.meaning} for m in MEASURES
    ]
    return pd.DataFrame(rows)


_TITLES = {
    "confidence": "Mean confidence minus share right: all, by real side, in bins of equal counts",
    "groups": "By real side, rig, channels and protocols",
    "baselines": "Baselines on the same cases",
    "confusion": "Confusion: truth by row, verdict by column; detectable cases without pairs",
    "effects": "Per effect: cases found by level, smallest magnitude found in at least half",
    "reliability": "Confidence and share right",
    "cases": "Cases",
}
_CASE_COLUMNS = ["number", "mode", "real", "rig", "channels", "hidden", "excluded"]
_CASE_COLUMNS += ["oracle_floors", "verdict", "right", "confidence", "gap", "left", "share"]


def markdown(found: Score) -> str:
    """The score as Markdown."""
    when = (
        "by the solver to which the set was committed before it was drawn"
        if found.frozen
        else "**not** by the solver to which the set was committed: blind only if its authors had "
        "neither the answers nor the seed"
    )
    again = f"{found.replayed} of them were solved again, with the same results"
    parts = [
        "# Blind score\n",
        f"{len(found.tables['cases'])} cases, solved {when}; {again}. "
        f"{found.solvers_tried} versions of the solver were run on them; with {found.healthy} "
        "healthy logs of every plant. "
        "Intervals: Wilson 95 % for shares, order statistics for medians. Headline figures are "
        "over cases whose true effects show: more is left without them than is ordinary, or, where "
        f"the law is exact, the log is less likely by {DETECTABLE_NATS:g} nats. Effects outside of "
        "the catalogue count beyond what is ordinary. Weaker ones are listed separately (`below`)."
        "\n",
        *(f"- {line}" for line in SEAL),
        "",
        tables.markdown(headline(found)),
    ]
    for name, title in _TITLES.items():
        table = found.tables[name]
        if name == "cases":
            table = table[_CASE_COLUMNS]
        if name == "groups":
            table = _turned(table)
        parts += [f"\n## {title}\n", tables.markdown(table)]
    return "\n".join(parts) + "\n"


def _turned(table: pd.DataFrame) -> pd.DataFrame:
    """Groups as columns, figures with their counts as rows."""
    rows = []
    for measure in MEASURES:
        values = zip(table[measure.name], table[f"{measure.name}_n"], strict=True)
        rows.append([measure.name, *(f"{tables.cell(v)} ({n})" if n else "" for v, n in values)])
    head = [f"{of} ({count})" for of, count in zip(table["of"], table["cases"], strict=True)]
    return pd.DataFrame(rows, columns=["figure (count)", *head])


def _records(table: pd.DataFrame) -> list[dict]:
    """Rows as plain data, empty cells as None."""
    return table.astype(object).where(table.notna(), None).to_dict("records")
