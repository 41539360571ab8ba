"""The page on what was tried to break the commands, from the campaign's table."""

import csv
from pathlib import Path

from _pages._source import read_text

TABLE = Path(__file__).resolve().parents[2] / "tests/campaign/found.csv"
HARM = ("changed", "stuck", "traceback", "crash", "hang", "memory", "silent", "long")


def pages() -> dict[str, str]:
    """The one page."""
    with TABLE.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        "reference/faults.md": read_text(
            "faults.md",
            inputs=_table([row for row in rows if row["part"] == "inputs"]),
            kills=_table([row for row in rows if row["part"] == "kills"]),
        )
    }


def _table(rows: list[dict[str, str]]) -> str:
    """A line per kind, over all seeds, and their sum."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    lines = [(kind, [row for row in rows if row["kind"] == kind]) for kind in kinds]
    body = [_line(kind, own) for kind, own in [*lines, ("together", rows)]]
    return "\n".join(["| kind | cases | refused | faults |", "|---|---|---|---|", *body])


def _line(kind: str, rows: list[dict[str, str]]) -> str:
    def total(name: str) -> int:
        return sum(int(row[name]) for row in rows)

    faults = ", ".join(f"{total(name)} {name}" for name in HARM if total(name)) or "0"
    return f"| {kind} | {total('cases')} | {total('refused')} | {faults} |"
