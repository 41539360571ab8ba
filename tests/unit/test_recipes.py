"""The recipes of `docs/contribute` work: their files are added, and what the pages say is run.

Packages are linked into a folder of their own, where a page's file is the only one that is added,
so a recipe changes nothing here and compiled code is shared.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "contribute"
PACKAGES = ("backends", "baselines", "diagnosis", "leaderboard", "tasks", "tests")
KINDS = ("effect", "task", "observation", "learner", "backend")
QUICK = ("task",)
"""Those whose commands are no slow test."""
MOST_LINES = 10
"""Of code, without docstrings and comments."""
_CALLS = """import sys
import pytest
from benchmark.cli.app import call
for line in sys.argv[1:]:
    tool, *words = line.split()
    if code := call(words) if tool == "bench" else pytest.main(["-p", "no:cacheprovider", *words]):
        sys.exit(code)
"""
_BLOCK = re.compile(r"^```(?:python|xml|yaml)\n(?:# |<!-- )(\S+)[^\n]*\n(.*?)^```$", re.M | re.S)
_COMMAND = re.compile(r"^    ((?:bench|pytest) .*)$", re.M)


def page(kind: str) -> str:
    """The text of a recipe."""
    return (PAGES / f"{kind}.md").read_text()


def files(kind: str) -> dict[str, str]:
    """The files of a recipe: each block of code begins with its path."""
    return dict(_BLOCK.findall(page(kind)))


def linked(tree: Path) -> None:
    """Fill a folder with the packages: links, but for the one that looks for plug-ins."""
    shutil.copytree(ROOT / "benchmark", tree / "benchmark")
    shutil.copy(ROOT / "pyproject.toml", tree)
    for package in PACKAGES:
        for folder, names, found in os.walk(ROOT / package):
            here = tree / Path(folder).relative_to(ROOT)
            here.mkdir(exist_ok=True)
            caches = [name for name in names if name == "__pycache__"]
            names[:] = [n for n in names if n not in ("__pycache__", "policies", "results")]
            for name in found + caches:
                (here / name).symlink_to(Path(folder) / name)


def call(commands: list[str], tree: Path) -> str:
    """What commands of a page print, all in one process; fails where one does."""
    done = subprocess.run(
        [sys.executable, "-c", _CALLS, *commands],
        cwd=tree,
        env={
            **os.environ,
            "PYTHONPATH": f"{tree}{os.pathsep}{ROOT}",
            "PYTHONDONTWRITEBYTECODE": "1",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{commands}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def code_lines(text: str) -> int:
    """Lines of a file that hold code: no docstring, no comment, nothing blank."""
    tree = ast.parse(text)
    said: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            said |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = {n for n, line in enumerate(text.splitlines(), 1) if line.strip()}
    return len([n for n in lines - said if not text.splitlines()[n - 1].lstrip().startswith("#")])


@pytest.mark.parametrize("kind", KINDS)
def test_recipe_has_ten_lines_of_code_at_most(kind: str) -> None:
    """Add a plug-in of every kind with one file of ten lines of code."""
    (text,) = files(kind).values()
    assert code_lines(text) <= MOST_LINES


@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=() if k in QUICK else pytest.mark.slow) for k in KINDS],
)
def test_recipe_does_what_its_page_says(kind: str, tmp_path: Path) -> None:
    """Find the plug-in under its name, and run every command of the page that tries it."""
    linked(tmp_path)
    ((path, text),) = files(kind).items()
    (tmp_path / path).write_text(text)
    tried = page(kind).partition("## Try it\n")[2].partition("Then let the tests")[0]
    commands = _COMMAND.findall(tried)
    assert commands
    listed = call(["bench list --json", *commands], tmp_path)
    assert f'"{Path(path).stem.replace("_", "-")}"' in listed.splitlines()[0]


def test_robot_is_diagnosed_from_the_files_of_its_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Excite a robot, log what a sound one does, and diagnose it, as the page says."""
    for path, text in files("robot").items():
        (tmp_path / path).parent.mkdir(exist_ok=True)
        (tmp_path / path).write_text(text)
    monkeypatch.chdir(tmp_path)
    excite, diagnose = (line.split()[1:] for line in _COMMAND.findall(page("robot")))
    assert cli.call(excite) == 0
    played(tmp_path)
    assert cli.call(diagnose) == 0
    assert (tmp_path / "answer" / "diagnosis.json").exists()


def played(folder: Path) -> None:
    """Play the commands of `folder` on a joint with the inertia of the model, and log them."""
    asked = pd.read_csv(folder / "commands.csv")
    inertia, dt_s = 0.01 + 0.0015 + 0.4 * 0.1**2, 1e-4
    read = []
    for _, rows in asked.groupby("episode"):
        command, period_s = rows["command_rad.elbow"].to_numpy(), rows["t_s"].diff().median()
        angle, speed = command[0], 0.0
        for target in command:
            read.append(angle)
            for _ in range(round(period_s / dt_s)):
                torque = np.clip(30.0 * (target - angle) - 0.6 * speed, -6.0, 6.0)
                weight = 0.4 * 0.1 * 9.81 * np.cos(angle)
                speed += dt_s / inertia * (torque + weight)
                angle += dt_s * speed
    noise = np.random.default_rng(0).normal(0.0, 1e-4, len(read))
    asked["position_rad.elbow"] = np.array(read) + noise
    columns = ["episode", "t_s", "command_rad.elbow", "position_rad.elbow"]
    asked[columns].to_csv(folder / "arm" / "samples.csv", index=False)
