"""What a command left, without what differs from call to call."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pandas as pd

VOLATILE = frozenset(
    {"wall_s", "env_steps_per_s", "provenance", "cpu_s", "command", "finished", "state", "time"}
)
"""Keys and columns with times and circumstances."""
LEFT_OUT = ("provenance.json", "report.html", ".log", "transfer.json", "leaderboard.html")
"""Files with nothing else in them, or made from the others."""


def contents(folder: Path) -> dict[str, str]:
    """A digest of each file under a folder, by name."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        str(path.relative_to(folder)): _digest(path)
        for path in files
        if not path.name.endswith(LEFT_OUT)
    }


def differing(one: Path, other: Path) -> list[str]:
    """Files that are not the same in two folders, by name."""
    left, right = contents(one), contents(other)
    return sorted(name for name in left.keys() | right.keys() if left.get(name) != right.get(name))


def _digest(path: Path) -> str:
    return hashlib.sha256(_lasting(path)).hexdigest()


def _lasting(path: Path) -> bytes:
    if path.suffix == ".json":
        return json.dumps(_without(json.loads(path.read_text())), sort_keys=True).encode()
    if path.suffix == ".parquet":
        return pd.read_parquet(path).to_csv().encode()
    if path.suffix == ".csv" and path.read_text().strip():
        table = pd.read_csv(path)
        return table.drop(columns=list(VOLATILE & set(table.columns))).to_csv().encode()
    return path.read_bytes()


def _without(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without(value) for key, value in data.items() if key not in VOLATILE}
    return [_without(value) for value in data] if isinstance(data, list) else data
