"""The sets on which a solver is judged, by name: drawn, solved and scored, each step once."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from rich.table import Table

from benchmark import blind
from benchmark.errors import UsageError, unknown

FILE = Path(__file__).with_name("blind_sets.yaml")
STEPS = ("draw", "solve", "score")
SHOWN = ("top1", "none_accused", "none_false_alarm", "unknown_seen_or_near", "pairs_exact")
"""Figures that are printed of every set."""


def sets() -> Mapping[str, Mapping[str, Any]]:
    """The options of `bench blind make` by the name of a set."""
    return yaml.safe_load(FILE.read_text())


def judge(
    names: Sequence[str], out: Path, steps: Sequence[str], workers: int | None
) -> tuple[dict[str, Any], Table]:
    """Take the steps that the sets still need, in `out`; all sets by default."""
    known = sets()
    for name in names:
        if name not in known:
            raise unknown("set", name, tuple(known))
    if wrong := [step for step in steps if step not in STEPS]:
        raise unknown("step", wrong[0], STEPS)
    rows = [
        {"set": name, **_judge(name, known[name], out, steps, workers)} for name in names or known
    ]
    table = Table("set", "cases", *SHOWN, header_style="bold")
    for row in rows:
        table.add_row(row["set"], str(row["cases"]), *(_cell(row, name) for name in SHOWN))
    return {"status": "done", "sets": rows}, table


def _judge(
    name: str, options: Mapping[str, Any], out: Path, steps: Sequence[str], workers: int | None
) -> dict[str, Any]:
    folder, answers = out / name, out / "sealed" / f"{name}.json"
    if "draw" in steps and not folder.exists():
        _draw(options, folder, answers, workers)
    if not folder.exists():
        raise UsageError(f"{folder} is not drawn; give --stages {','.join(STEPS)}")
    if "solve" in steps:
        blind.run(folder, workers, False)
    found: dict[str, Any] = {"cases": options["cases"], "dir": str(folder)}
    if "score" in steps:
        said, _ = blind.score(folder, answers, out / "scores" / name, workers)
        found |= {key: said[key] for key in SHOWN} | {"intervals": said["intervals"]}
    return found


def _draw(options: Mapping[str, Any], folder: Path, answers: Path, workers: int | None) -> None:
    """Make a set; what a killed call left of it is made again."""
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    answers.unlink(missing_ok=True)
    wanted = blind.settings(
        options["cases"],
        options["real"],
        options["rig"],
        "all",
        "all",
        "all",
        healthy=options.get("healthy_logs", 0),
    )
    blind.make(wanted, options["seed"], part, answers, workers)
    part.rename(folder)


def _cell(row: Mapping[str, Any], name: str) -> str:
    """A share as hits of a count."""
    if row.get(name) is None:
        return ""
    count = row["intervals"][name]["count"]
    return f"{round(row[name] * count)} of {count}"
