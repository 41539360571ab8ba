"""Which code solves, and whether it is still the code that a set was committed to."""

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
"""What the solver replays grasps on, whatever engine is real."""


def imported(entry: str) -> set[str]:
    """Files of this repository that a module imports, itself and what these import included."""
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
    """Modules that a file may mean by its imports."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names


@cache
def solver_files() -> dict[str, str]:
    """SHA-256 of every file that decides what the solver says, as this process first saw them."""
    effects = (str(p.relative_to(ROOT)) for p in (ROOT / "backends/effects").glob("*.py"))
    names = sorted({*imported(ENTRY), *imported(f"backends.{ENGINE}"), *effects, RULES})
    return {name: hashlib.sha256((ROOT / name).read_bytes()).hexdigest() for name in names}


def commitment(answers: str, cases: int) -> Commitment:
    """What is committed to now: the answers' text, and the solver as it is."""
    files = solver_files()
    return Commitment(
        answers_sha256=hashlib.sha256(answers.encode()).hexdigest(),
        rules_version=int(yaml.safe_load((ROOT / RULES).read_text())["version"]),
        solver_sha256=_together(files),
        files=files,
        cases=cases,
    )


def changed(promised: Commitment) -> list[str]:
    """Files of the solver that are not as they were when it was committed to."""
    files = solver_files()
    names = sorted({*files, *promised.files})
    return [name for name in names if files.get(name) != promised.files.get(name)]


def solver() -> dict:
    """Which solver this is: version of its rules, and hash of all its files."""
    now = commitment("", 0)
    return {"rules_version": now.rules_version, "solver_sha256": now.solver_sha256}


def _together(files: dict[str, str]) -> str:
    lines = "".join(f"{name} {digest}\n" for name, digest in sorted(files.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
