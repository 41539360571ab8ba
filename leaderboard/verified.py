"""Which rows were verified: their policies were replayed, and the scores are what the rows say.

A mark belongs to what a row claims (see `row_key`), so that an edited row loses it.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from files.bounded import read_json

VERIFIED_FILE = "verified.json"


def read_verified(folder: Path) -> dict[str, dict]:
    """The marks in a leaderboard's folder, by the key of the row; none where there is no file.

    Raises ValueError where the file is damaged.
    """
    path = folder / VERIFIED_FILE
    if not path.exists():
        return {}
    marks = read_json(path)
    if not all(isinstance(mark, dict) for mark in marks.values()):
        raise ValueError(f"{path} holds no marks by row")
    return marks


def verified_text(marks: Mapping[str, dict]) -> str:
    """The file's text, a line per row."""
    lines = [f"  {json.dumps(key)}: {json.dumps(marks[key])}" for key in sorted(marks)]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def count_verified(keys: Iterable[str], marks: Mapping[str, dict]) -> int:
    """How many of these rows carry a mark."""
    return sum(key in marks for key in keys)
