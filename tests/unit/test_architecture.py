"""The house keeps its floors: imports go down, engines and learners stay in their own files."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from benchmark.parts import registry

ROOT = Path(__file__).resolve().parents[2]
FLOORS = {
    "files": set(),
    "backends": {"files"},
    "tasks": {"backends", "files"},
    "baselines": {"tasks", "backends", "files"},
    "diagnosis": {"baselines", "tasks", "backends", "files"},
    "leaderboard": {"files"},
    "benchmark": {"leaderboard", "diagnosis", "baselines", "tasks", "backends", "files"},
    "stickbench": {"benchmark", "leaderboard", "diagnosis"},
}
HOMES = {
    "mujoco": {
        "backends/mujoco.py",
        "backends/_mujoco",
        "backends/mujoco_warp.py",
        "backends/mjcf.py",
        "backends/_mjcf",
        "benchmark/pictures/_scene.py",
        "diagnosis/blind/mechanics/plain.py",
    },
    "pybullet": {"backends/_bullet_quiet.py"},
    "sapien": {"backends/sapien.py"},
    "mujoco_warp": {"backends/mujoco_warp.py"},
    "warp": {"backends/mujoco_warp.py", "backends/_warp_drive.py"},
    "stable_baselines3": {"baselines/"},
    "rsl_rl": {"baselines/"},
    "tensordict": {"baselines/"},
    "torch": {"baselines/"},
    "typer": {f"benchmark/cli/{name}.py" for name in ("app", "command", "blind", "doctor")},
}
"""Where a library may be imported; the picture of the hand is drawn by one engine's renderer.

A command declares its options, and leaves it to `command` to make them.
"""


@cache
def imports() -> list[tuple[str, str]]:
    """Pairs of a file and a top-level package that it imports."""
    return list(_imports())


def _imports() -> Iterator[tuple[str, str]]:
    for room in FLOORS:
        for path in sorted((ROOT / room).rglob("*.py")):
            name = str(path.relative_to(ROOT))
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    yield from ((name, alias.name.split(".")[0]) for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module:
                    yield name, node.module.split(".")[0]


def test_imports_go_down_the_floors():
    """Import only from floors below."""
    wrong = [
        f"{file} imports {package}"
        for file, package in imports()
        if package in FLOORS
        and package != (room := file.split("/")[0])
        and package not in FLOORS[room]
    ]
    assert not wrong


@pytest.mark.parametrize("library", sorted(HOMES))
def test_engines_and_learners_stay_at_home(library):
    """Import an engine or a learner in its own file alone."""
    found = {file for file, package in imports() if package == library}
    assert not [file for file in found if not file.startswith(tuple(HOMES[library]))]


def test_tasks_name_no_engine():
    """Mention no engine in a task, an observation or the batched environment."""
    for path in (ROOT / "tasks").rglob("*.py"):
        text = path.read_text().lower()
        assert not [name for name in registry.names("backend") if name in text], path


def test_every_package_is_installed():
    """Name every folder with Python files in pyproject.toml, which finds none by itself."""
    text = (ROOT / "pyproject.toml").read_text()
    for room in FLOORS:
        for path in (ROOT / room).rglob("__init__.py"):
            package = ".".join(path.parent.relative_to(ROOT).parts)
            assert f'"{package}"' in text


def test_pinned_versions_cover_every_dependency():
    """Pin every direct dependency in the constraints file."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [name for extra in project["optional-dependencies"].values() for name in extra]
    wanted = [w for w in (*project["dependencies"], *extras) if not w.startswith("stickbench[")]
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert not [w for w in wanted if re.split(r"\[|>=", w)[0] not in pinned]
