"""What the unit tests share: one finished run."""

import tempfile
from pathlib import Path

import pytest
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
