"""The sets on which a solver is judged, by name: drawn, solved and scored, each stage once."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from rich.table import Table

from benchmark.errors import UsageError, unknown
from benchmark.gap import blind

FILE = Path(__file__).with_name("blind_sets.yaml")
STAGES = ("draw", "solve", "score")
SHOWN = ("top1", "none_accused", "none_false_alarm", "unknown_seen_or_near", "pairs_exact")
"""Figures that are printed of every set."""


def sets() -> Mapping[str, Mapping[str, Any]]:
    """The options of `bench blind make` by the name of a set."""
    return yaml.safe_load(FILE.read_text())


def judge(
    names: Sequence[str], out: Path, stages: Sequence[str], workers: int | None
) -> tuple[dict[str, Any], Table]:
    """Take the stages that the sets still need, in `out`; all sets by default.

    Those of one group that are asked for are scored together.
    """
    known = sets()
    for name in names:
        if name not in known:
            raise unknown("set", name, tuple(known))
    if wrong := [stage for stage in stages if stage not in STAGES]:
        raise unknown("stage", wrong[0], STAGES)
    chosen = list(names or known)
    for name in chosen:
        if "draw" in stages and not (out / name).exists():
            _draw(known[name], out / name, _answers(out, name), workers)
        if not (out / name).exists():
            raise UsageError(f"{out / name} is not drawn; give --stages {','.join(STAGES)}")
        if "solve" in stages:
            blind.run(out / name, workers, False)
    groups = dict.fromkeys(map(group, chosen)) if "score" in stages else {}
    rows = [_score(one, [n for n in chosen if group(n) == one], out, workers) for one in groups]
    table = Table("sets", "cases", *SHOWN, header_style="bold")
    for row in rows:
        table.add_row(row["sets"], str(row["cases"]), *(_cell(row, name) for name in SHOWN))
    return {"status": "done", "sets": chosen, "scores": rows}, table


def group(name: str) -> str:
    """What sets that are scored together have in common: `makes` of `makes-2`."""
    return name.split("-")[0]


def _answers(out: Path, name: str) -> Path:
    return out / "sealed" / f"{name}.json"


def _score(of: str, names: Sequence[str], out: Path, workers: int | None) -> dict[str, Any]:
    pairs = [(out / name, _answers(out, name)) for name in names]
    said, _ = blind.score(pairs, out / "scores" / of, workers)
    shown = {key: said[key] for key in ("cases", *SHOWN, "intervals")}
    return {"sets": ", ".join(names), **shown}


def _draw(options: Mapping[str, Any], folder: Path, answers: Path, workers: int | None) -> None:
    wanted = blind.settings(
        options["cases"],
        options["real"],
        options["rig"],
        "all",
        "all",
        "all",
        healthy=options.get("healthy_logs", 0),
    )
    blind.make(wanted, options["seed"], folder, answers, workers)


def _cell(row: Mapping[str, Any], name: str) -> str:
    """A share as hits of a count."""
    if row.get(name) is None:
        return ""
    count = row["intervals"][name]["count"]
    return f"{round(row[name] * count)} of {count}"
