"""Blind scores as `bench blind score` would write them, for the tests of their history."""

import json
from pathlib import Path

FIGURES = ("top1", "pairs_exact", "none_accused", "unknown_recall")
MODES = ("single", "pair", "none", "unknown")


def score(
    right: int = 8, count: int = 10, sides: tuple[str, ...] = ("mujoco",), frozen: bool = True
) -> dict:
    """A score with as many right of so many in each figure, on each real side."""
    share = dict.fromkeys(FIGURES, right / count)
    counts = {f"{name}_n": count for name in FIGURES}
    groups = [{"by": "real", "of": side, "cases": 4, **share, **counts} for side in sides]
    groups += [{"by": "rig", "of": "finger", "cases": 4 * len(sides), **share, **counts}]
    return {
        "cases": 4 * len(sides),
        **share,
        "frozen": frozen,
        "healthy": 0,
        "intervals": {name: {"low": 0.0, "high": 1.0, "count": count} for name in FIGURES},
        "tables": {"cases": [{"number": n, "mode": m} for n, m in enumerate(MODES)]}
        | {"groups": groups},
    }


def save(path: Path, found: dict) -> Path:
    path.write_text(json.dumps(found))
    return path
