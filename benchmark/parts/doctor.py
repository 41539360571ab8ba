"""`bench doctor`: check whether engines and learners are installed and work, and how to fix them.

`bench doctor physics`: compare each engine with closed forms and with the reference engine.
"""

import re
import subprocess
import sys
from pathlib import Path

from rich.console import Group
from rich.table import Table

from benchmark.console import Bar
from benchmark.parts import registry
from benchmark.provenance import version
from files.plugins import Part

_SYSTEM = {"libX11": "libx11-6", "libGL": "libgl1", "libEGL": "libegl1", "libvulkan": "libvulkan1"}
_REFUSED = " is refused: "
"""In what `make_env` says of an engine that cannot have a world: nothing to install."""
_PROBES = {
    "backend": (
        "import sys; from benchmark.settings.run_spec import RunSpec;"
        "run = RunSpec(backend=sys.argv[1], task='line', worlds=1);"
        "env = run.make_env([run.world()], 0, 1); env.reset();"
        "env.step([[0.0] * env.action_width]); env.close()"
    ),
    "algo": (
        "import sys; from benchmark.parts import registry; registry.load('algo', sys.argv[1])"
    ),
}


def examine() -> tuple[dict, Table]:
    """Try every backend and learner in its own process."""
    rows = [_examine(kind, name) for kind in _PROBES for name in registry.names(kind)]
    table = Table("part", "name", "package", "version", "state", "what to do", header_style="bold")
    for row in rows:
        table.add_row(*(str(row[key] or "-") for key in row))
    return {"ok": all(row["state"] == "works" for row in rows), "parts": rows}, table


def examine_physics(backend: str, out: Path | None) -> tuple[dict, Group]:
    """Run the physics checks on one engine or all, and write them to `out` as Markdown."""
    from benchmark.physics import report, suite

    names = registry.chosen("backend", backend)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.open("a").close()  # refuses what cannot be written before a minute is spent
    with Bar("physics", suite.steps(names)) as bar:
        found = suite.examine(names, bar.update)
    if out is not None:
        out.write_text(report.markdown(found))
    return report.as_data(found), report.tables(found)


def _examine(kind: str, name: str) -> dict:
    package = registry.part(kind, name).distribution
    done = subprocess.run(
        [sys.executable, "-P", "-c", _PROBES[kind], name],
        capture_output=True,
        text=True,
        check=False,
    )
    works = done.returncode == 0
    last = (done.stderr.strip().splitlines() or ["it died without a message"])[-1]
    last = re.sub(r"^[\w.]+: (?=\S)", "", last) if "Error: " in last else last
    return {
        "part": kind,
        "name": name,
        "package": package,
        "version": version(package) if package else None,
        "state": "works" if works else last,
        "what_to_do": None if works else _remedy(last, registry.part(kind, name)),
    }


def _remedy(trouble: str, found: Part) -> str | None:
    for library, package in _SYSTEM.items():
        if library in trouble:
            return f"apt-get install {package}"
    if _REFUSED in trouble:
        return None
    return registry.installs(found)
