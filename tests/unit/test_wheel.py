"""The wheel: it holds what the checkout has, and needs no checkout."""

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packed import tracked

from benchmark.parts.registry import ROOT


@pytest.mark.slow
def test_wheel_holds_every_file_of_the_packages(wheel: Path) -> None:
    """Pack every module and every file of data, and the licence."""
    rooms = {name.split(".")[0] for name in project()["tool"]["setuptools"]["packages"]}
    wanted = {name for name in tracked() if name.split("/")[0] in rooms}
    held = set(zipfile.ZipFile(wheel).namelist())
    assert sorted(wanted - held) == []
    assert any(name.endswith("licenses/LICENSE") for name in held)


@pytest.mark.slow
def test_demo_runs_from_the_wheel(unpacked: Path, tmp_path: Path) -> None:
    """Run `bench demo` from the unpacked wheel, with no checkout on the path."""
    environment = {**os.environ, "PYTHONPATH": str(unpacked)}
    command = [sys.executable, "-m", "benchmark", "demo"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "backlash of 1.5" in done.stdout
    assert (tmp_path / "demo/report.html").exists()


def project() -> dict:
    """The project file."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())
