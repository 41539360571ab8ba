"""`bench view`: pictures of a scripted run, and what it refuses."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from benchmark import _scene, cli
from benchmark.errors import CommandError
from benchmark.evaluate import SMOKE_EPISODES
from benchmark.run import run
from benchmark.run_spec import RunSpec
from benchmark.view import view

PACKAGES = "apt-get install libegl1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run that trained nothing."""
    spec = RunSpec(backend="mujoco", task="circle", algo="hold-still", steps=0, smoke=True)
    path = tmp_path_factory.mktemp("runs") / "still"
    run(spec, path, workers=1, resume=False, force=False)
    return path


def red(pixels: np.ndarray) -> np.ndarray:
    """Which pixels are clearly red."""
    r, g, b = np.moveaxis(pixels[..., :3], -1, 0)
    return (r > 0.6) & (g < 0.35) & (b < 0.35)


def opengl_works(platform: str) -> bool:
    """Whether an empty scene can be drawn without a screen."""
    draw = "import mujoco; mujoco.Renderer(mujoco.MjSpec().compile()).close()"
    environment = {**os.environ, "MUJOCO_GL": platform, "PYOPENGL_PLATFORM": platform}
    command = [sys.executable, "-c", draw]
    return subprocess.run(command, env=environment, capture_output=True).returncode == 0


def test_figure_is_drawn_in_red_and_blue(folder: Path, tmp_path: Path) -> None:
    """Draw the paths of two episodes, and leave nothing but the picture."""
    out = tmp_path / "new" / "paths.png"
    result = view(folder, out, "figure", {}, episodes=2, workers=1)
    assert result["written"] == str(out)
    assert result["episodes"] == 2
    assert [p.name for p in out.parent.iterdir()] == ["paths.png"]
    pixels = imread(out)
    blue = (pixels[..., 2] > 0.6) & (pixels[..., 0] < 0.5)
    assert red(pixels).sum() > 100
    assert blue.sum() > 20


def test_replay_gives_the_scores_of_the_run(folder: Path, tmp_path: Path) -> None:
    """Replay as many episodes as the smoke run has and find its scores again."""
    from benchmark.run_folder import read_run

    result = view(folder, tmp_path / "all.png", "figure", {}, SMOKE_EPISODES, workers=1)
    scores = read_run(folder)["scores"]
    assert {name: result[name] for name in scores} == pytest.approx(scores)


def test_hand_is_drawn(folder: Path, tmp_path: Path) -> None:
    """Draw the hand: a full picture, not all sky, with the red reference in it."""
    if not any(opengl_works(platform) for platform in ("egl", "osmesa")):
        pytest.skip(f"no OpenGL without a screen here; {PACKAGES}")
    out = tmp_path / "hand.png"
    result = view(folder, out, "hand", {}, episodes=1, time_s=0.5, workers=1)
    pixels = imread(out)
    assert pixels.shape[:2] == (_scene.HEIGHT, _scene.WIDTH)
    assert (pixels[..., :3].max(axis=2) < 0.4).mean() > 0.01
    assert red(pixels).sum() > 100
    assert not result["stick_has_fallen"]


def test_missing_opengl_names_the_packages(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Say in one message what to install when no platform works."""
    monkeypatch.setattr(_scene, "_PLATFORMS", {"glx-less": "libegl1", "none": "libosmesa6"})
    with pytest.raises(CommandError, match=f"{PACKAGES} or apt-get install libosmesa6"):
        view(folder, tmp_path / "hand.png", "hand", {}, episodes=1, workers=1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--kind", "hnad"], "no kind of picture named 'hnad'; known: figure, hand. Did you mean"),
        (["--time", "1"], "--kind hand"),
        (["--kind", "hand", "--time", "7"], "allowed: 0.02 to 6"),
        (["--episodes", "0"], "allowed: 1 to 100"),
        (["--backend", "mujco"], "Did you mean 'mujoco'?"),
    ],
)
def test_wrong_option_is_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture, options: list[str], says: str
) -> None:
    """Exit with 2 and say what is allowed."""
    out = tmp_path / "x.png"
    assert cli._run(["view", str(folder), "--out", str(out), *options]) == 2
    assert says in capfd.readouterr().err
    assert not out.exists()


def test_missing_run_and_wrong_file_are_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    """Exit with 2 for a folder that is not there, and for a file that is not a PNG."""
    missing = tmp_path / "missing"
    assert cli._run(["view", str(missing), "--out", str(tmp_path / "x.png")]) == 2
    assert f"no run folder at {missing}" in capfd.readouterr().err
    assert cli._run(["view", str(folder), "--out", str(tmp_path / "x.mp4")]) == 2
    assert ".png" in capfd.readouterr().err
