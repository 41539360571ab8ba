"""The wheel: it holds what the checkout has, and needs no checkout."""

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from benchmark.parts.registry import ROOT

BESIDE = ("leaderboard/leaderboard.", "leaderboard/policies", "leaderboard/results")
BESIDE += ("leaderboard/figures", "leaderboard/transfer", "leaderboard/blind/history.csv")
BESIDE += ("leaderboard/blind/scores", "leaderboard/physics.json", "leaderboard/speed.json")
"""Results, which the package does not need."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of what git has."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(out)]
    subprocess.run([*command, str(source)], check=True)
    return next(out.glob("*.whl"))


def tracked() -> list[str]:
    """Files that git knows or would take up, but results."""
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")
    return [n for n in listed if n and not n.startswith(BESIDE) and (ROOT / n).is_file()]


@pytest.mark.slow
def test_wheel_holds_every_file_of_the_packages(wheel: Path) -> None:
    """Pack every module and every file of data, and the licence."""
    rooms = {name.split(".")[0] for name in project()["tool"]["setuptools"]["packages"]}
    wanted = {name for name in tracked() if name.split("/")[0] in rooms}
    held = set(zipfile.ZipFile(wheel).namelist())
    assert sorted(wanted - held) == []
    assert any(name.endswith("licenses/LICENSE") for name in held)


@pytest.mark.slow
def test_demo_runs_from_the_wheel(wheel: Path, tmp_path: Path) -> None:
    """Run `bench demo` from the unpacked wheel, with no checkout on the path."""
    packed, here = tmp_path / "packed", tmp_path / "here"
    zipfile.ZipFile(wheel).extractall(packed)
    here.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(packed)}
    command = [sys.executable, "-m", "benchmark", "demo"]
    done = subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "backlash of 1.5" in done.stdout
    assert (here / "demo/report.html").exists()


def project() -> dict:
    """The project file."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())
