"""`bench view RUN --live`: what the browser is shown of a run, with no screen and no browser."""

from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

from benchmark.cli import app as cli
from benchmark.pictures._replay import replay
from benchmark.runs.run import run
from benchmark.settings.run_spec import RunSpec

SPEC = RunSpec(backend="bullet", task="circle", algo="hold-still", steps=0, smoke=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run that trained nothing."""
    path = tmp_path_factory.mktemp("runs") / "still"
    run(SPEC, path, workers=1)
    return path


def test_the_slider_moves_what_is_shown(folder: Path) -> None:
    """Serve a page, and pose hand, stick, taxels, reference and trace as the slider says."""
    pytest.importorskip("viser")
    from benchmark.pictures.live import Live

    recording = replay(SPEC, folder, episodes=1, workers=1)
    live = Live(recording, "a circle", port=0)
    assert b"<html" in urlopen(live.url).read().lower()
    live.slider.value = 40
    live.show(40)
    state, nodes = recording.states, live.nodes
    assert np.allclose(nodes["stick"].position, state.stick_pos_m[40])
    assert np.allclose(nodes["stick"].wxyz, state.stick_quat_wxyz[40])
    assert np.allclose(nodes["reference"].position, recording.reference_m[40, 0])
    assert len(nodes["trace"].points) == 41
    red = (nodes["taxels"].colors[:, 0] > 200).reshape(recording.touch.active[40].shape)
    assert (red == recording.touch.active[40]).all() and red.any()
    live.server.stop()


def test_a_live_view_writes_no_file(folder: Path, tmp_path: Path, capfd) -> None:
    """Ask for a file or for the browser, one of them."""
    assert cli.call(["view", str(folder)]) == 2
    assert "give --out FILE, or --live" in capfd.readouterr().err
    assert cli.call(["view", str(folder), "--live", "--out", str(tmp_path / "x.png")]) == 2
    assert "leave --out out" in capfd.readouterr().err
