"""The results of the physics checks: as plain data, as tables on a terminal, as Markdown."""

import math
from collections.abc import Sequence
from dataclasses import asdict

from rich.console import Group
from rich.table import Table

from benchmark.parts import registry
from benchmark.physics.check import Check
from benchmark.physics.suite import Findings
from benchmark.provenance import provenance
from benchmark.settings.run_spec import REFERENCE

_HEAD = ("check", "figure", "expected", "largest error", "unit", "result")


def as_data(found: Sequence[Findings]) -> dict:
    """One JSON object; figures that are not finite become null."""
    return {
        "ok": all(f.passed for f in found),
        "reference": REFERENCE,
        "engines": {
            f.engine: {
                "ok": f.passed,
                "package": registry.part("backend", f.engine).distribution,
                "trouble": f.trouble,
                "checks": [_row(check) for check in f.checks],
            }
            for f in found
        },
        "provenance": provenance(),
    }


def _row(check: Check) -> dict:
    row = {**asdict(check), "passed": check.passed}
    return row if math.isfinite(check.figure) else {**row, "figure": None}


def tables(found: Sequence[Findings]) -> Group:
    """One table per engine."""
    return Group(*(_table(f) for f in found))


def _table(found: Findings) -> Table:
    table = Table(*_HEAD, title=_title(found), title_justify="left", header_style="bold")
    for check in found.checks:
        table.add_row(*_cells(check), style=None if check.passed else "bold red")
    return table


def markdown(found: Sequence[Findings]) -> str:
    """The tables with the reasons of all bounds, and where the figures come from."""
    made = provenance()
    engines = [registry.part("backend", name).distribution for name in registry.usual("backend")]
    behind = [name for name in (*engines, "numpy", "numba") if name in made["versions"]]
    versions = ", ".join(f"{name} {made['versions'][name]}" for name in behind)
    parts = [
        "# Physics checks",
        f"Made by `{made['command']}` on {made['cpu']}, Python {made['python']}, {versions}. "
        "docs/results/physics.md explains them.",
    ]
    for f in found:
        parts += [f"## {_title(f)}", _grid(f.checks)]
    return "\n\n".join(parts) + "\n"


def _grid(checks: Sequence[Check]) -> str:
    rows = [(*_HEAD, "why"), ("---",) * (len(_HEAD) + 1)]
    rows += [(*_cells(check), check.why) for check in checks]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _title(found: Findings) -> str:
    if found.trouble is not None:
        return f"{found.engine}: {found.trouble}"
    failed = sum(not check.passed for check in found.checks)
    verdict = f"{failed} of {len(found.checks)} failed" if failed else "all passed"
    return f"{found.engine}: {verdict}"


def _cells(check: Check) -> tuple[str, ...]:
    figure = f"{check.figure:.6g}" if check.expected else f"{check.figure:.2g}"
    result = "pass" if check.passed else "FAIL"
    return check.name, figure, f"{check.expected:.6g}", f"{check.bound:.2g}", check.unit, result
