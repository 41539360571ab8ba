"""What a campaign found, counted by kind and written as it goes."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path

from files.atomic import write_atomically

COUNTED = ("changed", "stuck", "traceback", "crash", "hang", "memory", "silent", "long")
"""Faults of a case: a row that changed, a folder that is stuck, and those of `watch.Outcome`."""
NUMBERS = ("cases", "kills", "refused", *COUNTED)
COLUMNS = ("part", "kind", "seed", *NUMBERS, "repeat")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case and how it ended."""

    part: str
    """inputs or kills."""
    kind: str
    seed: int
    number: int
    """Of the cases of this kind, from 0."""
    kills: int = 0
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


class Table:
    """Counts by kind and seed, in a CSV file if there is one."""

    def __init__(self, path: Path | None = None) -> None:
        self._path, self._rows = path, {}
        if path is not None and path.exists():
            with path.open(newline="") as file:
                for row in csv.DictReader(file):
                    counts = {name: int(row[name]) for name in NUMBERS}
                    self._rows[row["part"], row["kind"], int(row["seed"])] = row | counts

    def forget(self, part: str, kind: str, seed: int) -> None:
        """Take out a kind, to count it from the start."""
        self._rows.pop((part, kind, seed), None)

    def cases(self, part: str, kind: str, seed: int) -> int:
        """How many cases of a kind are counted."""
        row = self._rows.get((part, kind, seed))
        return 0 if row is None else row["cases"]

    def add(self, case: Case) -> None:
        """Count a case, and write the file."""
        key = (case.part, case.kind, case.seed)
        new = dict(zip(("part", "kind", "seed"), key, strict=True)) | dict.fromkeys(NUMBERS, 0)
        row = self._rows.setdefault(key, new | {"repeat": ""})
        row["cases"] += 1
        row["kills"] += case.kills
        row["refused"] += case.refused
        if case.fault:
            row[case.fault] += 1
            row["repeat"] = "; ".join(filter(None, (row["repeat"], case.repeat)))
        if self._path is not None:
            write_atomically(self._path, self._text())

    def _text(self) -> str:
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows[key] for key in sorted(self._rows))
        return text.getvalue()

    def show(self) -> str:
        """A line per kind, and what went wrong."""
        lines = [
            f"{row['part']:7} {row['kind']:24} {row['cases']:5} cases {row['kills']:5} kills "
            f"{row['refused']:5} refused "
            + " ".join(f"{row[fault]} {fault}" for fault in COUNTED if row[fault])
            for row in self._rows.values()
        ]
        return "\n".join([*lines, *(row["repeat"] for row in self._rows.values() if row["repeat"])])
