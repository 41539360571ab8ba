"""What the unit tests share: one finished run, and the wheel."""

import tempfile
import zipfile
from pathlib import Path

import pytest
from packed import make_wheel
from smoke import SMOKE

from benchmark.cli import app as cli


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished smoke run on the reference engine; only to be read.

    The folder `elsewhere` beside it is where temporary files go meanwhile.
    """
    folder = tmp_path_factory.mktemp("runs") / "finished"
    elsewhere = folder.parent / "elsewhere"
    elsewhere.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(elsewhere))
        assert cli.call([*SMOKE, "--backend", "mujoco", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of what git has."""
    return make_wheel(tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session")
def unpacked(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the wheel is installed."""
    folder = tmp_path_factory.mktemp("unpacked")
    zipfile.ZipFile(wheel).extractall(folder)
    return folder
