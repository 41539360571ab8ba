"""The page of every engine, task, observation, learner and more, as their files say themselves."""

from _pages._source import read_text
from benchmark.parts import listing


def pages() -> dict[str, str]:
    """The page: what `bench list` says; effects have pages of their own."""
    found, _ = listing.parts()
    kinds = {kind: lines for kind, lines in found.items() if kind != "effect"}
    tables = "\n".join(_table(kind, lines) for kind, lines in kinds.items())
    return {"reference/parts.md": read_text("parts.md", tables=tables)}


def _table(kind: str, lines: dict[str, str]) -> str:
    rows = [f"| `{name}` | {line} |" for name, line in lines.items()]
    return "\n".join([f"## {kind}\n", "| name | what it is |", "|---|---|", *rows, ""])
