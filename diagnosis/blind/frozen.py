"""The files of the solver, and whether they are those that a set was committed to."""

import ast
import hashlib
from functools import cache
from pathlib import Path

import yaml

from diagnosis.blind.files import Commitment

ROOT = Path(__file__).resolve().parents[2]
ENTRY = "diagnosis.diagnose"
RULES = "diagnosis/attribution/rules.yaml"
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
    names = sorted({*imported(ENTRY), *imported(f"backends.{ENGINE}"), *effects, RULES})
    return {name: hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in names}


def commitment(answers: str, cases: int) -> Commitment:
    """The commitment for these answers and the current solver."""
    files = solver_files()
    return Commitment(
        answers_sha256=hashlib.sha256(answers.encode()).hexdigest(),
        rules_version=int(yaml.safe_load((ROOT / RULES).read_text())["version"]),
        solver_sha256=_together(files),
        files=files,
        cases=cases,
    )


def changed(promised: Commitment) -> list[str]:
    """Files of the solver that have changed since the commitment."""
    files = solver_files()
    names = sorted({*files, *promised.files})
    return [name for name in names if files.get(name) != promised.files.get(name)]


def solver() -> dict:
    """The identity of this solver: its rules and the hash of all its files."""
    now = commitment("", 0)
    return {"rules_version": now.rules_version, "solver_sha256": now.solver_sha256}


def _together(files: dict[str, str]) -> str:
    lines = "".join(f"{name} {digest}\n" for name, digest in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
