"""What a campaign found, counted by kind."""

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

COUNTED = ("changed", "stuck", "traceback", "crash", "hang", "memory", "silent", "long")
"""Faults of a case: a row that changed, a folder that is stuck, and those of `watch.Outcome`."""
COLUMNS = ("part", "kind", "seed", "cases", "refused", "taken", *COUNTED, "repeat")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case and how it ended."""

    part: str
    """inputs or kills."""
    kind: str
    seed: int
    number: int
    refused: bool
    """Whether the command ended with a message and exit code 1 or 2."""
    fault: str = ""
    """One of COUNTED, or empty."""
    said: str = ""

    @property
    def repeat(self) -> str:
        """The command that repeats it."""
        words = f"--{self.part} --seed {self.seed} --only '{self.kind}' --case {self.number}"
        return f"python -m tests.campaign {words}"


def rows(cases: Sequence[Case]) -> list[dict[str, object]]:
    """A row per kind."""
    groups: dict[tuple[str, str, int], list[Case]] = {}
    for case in cases:
        groups.setdefault((case.part, case.kind, case.seed), []).append(case)
    return [
        {
            "part": part,
            "kind": kind,
            "seed": seed,
            "cases": len(group),
            "refused": sum(case.refused for case in group),
            "taken": sum(not case.refused and not case.fault for case in group),
            **{fault: Counter(case.fault for case in group)[fault] for fault in COUNTED},
            "repeat": "; ".join(case.repeat for case in group if case.fault),
        }
        for (part, kind, seed), group in groups.items()
    ]


def add(cases: Sequence[Case], path: Path) -> None:
    """Put the rows into a file, in the place of those of the same kinds and seeds."""
    new = rows(cases)
    fresh = {(str(row["part"]), str(row["kind"]), str(row["seed"])) for row in new}
    old: list[dict[str, object]] = []
    if path.exists():
        with path.open(newline="") as file:
            old = [dict(row) for row in csv.DictReader(file)]
    kept = [row for row in old if (row["part"], row["kind"], row["seed"]) not in fresh]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(sorted([*kept, *new], key=lambda row: (row["part"], row["kind"])))


def show(cases: Sequence[Case]) -> str:
    """A line per kind, and what went wrong."""
    lines = [
        f"{row['part']:7} {row['kind']:20} {row['cases']:5} cases {row['refused']:5} refused "
        + " ".join(f"{row[fault]} {fault}" for fault in COUNTED if row[fault])
        for row in rows(cases)
    ]
    return "\n".join([*lines, *(case.repeat for case in cases if case.fault)])
