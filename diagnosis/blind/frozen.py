"""The files of the solver, and whether they are those that a set was committed to."""

import ast
import hashlib
from functools import cache
from pathlib import Path

from diagnosis.blind.files import BlindSet, Commitment

ROOT = Path(__file__).resolve().parents[2]
ENTRY = "diagnosis.walk"
"""What solves logs."""
CURVE = "diagnosis/verdict/curve.json"
ENGINE = "mujoco"
"""The engine on which the solver replays grasps, whatever engine is real."""


def imported(entry: str) -> set[str]:
    """The file of a module and all files of this repository that it imports, also indirectly."""
    found: set[str] = set()
    waiting = [entry]
    while waiting:
        path = ROOT / f"{waiting.pop().replace('.', '/')}.py"
        name = str(path.relative_to(ROOT))
        if path.exists() and name not in found:
            found.add(name)
            waiting += _named(ast.parse(path.read_text()))
    return found


def _named(tree: ast.AST) -> list[str]:
    """Modules that the imports of a file may refer to."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names


@cache
def solver_files() -> dict[str, str]:
    """SHA-256 of every file that decides the solver's results, as this process first read them."""
    effects = (str(p.relative_to(ROOT)) for p in (ROOT / "backends/effects").glob("*.py"))
    entries = (ENTRY, f"backends.{ENGINE}")
    names = sorted({CURVE, *effects, *(name for entry in entries for name in imported(entry))})
    return {name: hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in names}


def commitment(blind: BlindSet, answers_sha256: str, cases: int) -> Commitment:
    """The commitment for these answers, the logs as they are, and the current solver."""
    return Commitment(
        answers_sha256=answers_sha256,
        logs_sha256={f"{n:03d}": blind.log_sha256(n) for n in range(cases)},
        solver_sha256=solver_sha256(),
        files=solver_files(),
    )


def changed(promised: Commitment) -> list[str]:
    """Files of the solver that have changed since the commitment."""
    files = solver_files()
    names = sorted({*files, *promised.files})
    return [name for name in names if files.get(name) != promised.files.get(name)]


def solver_sha256() -> str:
    """The hash of all files of this solver."""
    files = sorted(solver_files().items())
    lines = "".join(f"{name} {digest}\n" for name, digest in files)
    return hashlib.sha256(lines.encode()).hexdigest()
