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
            inputs=_table([r for r in rows if r["part"] == "inputs"], ("cases", "refused")),
            kills=_table([r for r in rows if r["part"] == "kills"], ("cases", "kills")),
        )
    }


def _table(rows: list[dict[str, str]], counts: tuple[str, ...]) -> str:
    """A line per kind, over all seeds, and their sum."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    lines = [(kind, [row for row in rows if row["kind"] == kind]) for kind in kinds]
    body = [_line(kind, own, counts) for kind, own in [*lines, ("together", rows)]]
    head = ["kind", *counts, "faults"]
    return "\n".join([f"| {' | '.join(head)} |", "|---" * len(head) + "|", *body])


def _line(kind: str, rows: list[dict[str, str]], counts: tuple[str, ...]) -> str:
    def total(name: str) -> int:
        return sum(int(row[name]) for row in rows)

    faults = ", ".join(f"{total(name)} {name}" for name in HARM if total(name)) or "0"
    return f"| {' | '.join([kind, *(str(total(name)) for name in counts), faults])} |"
