"""`bench view`: pictures and videos of a scripted run, and what it refuses."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from benchmark.cli import app as cli
from benchmark.errors import CommandError, UsageError
from benchmark.pictures import _render
from benchmark.pictures._curve import draw_curves, read_curves
from benchmark.pictures._plots import draw_joints, draw_touch
from benchmark.pictures._replay import Recording, replay
from benchmark.pictures.view import LOOP_SIZE, PICTURE_SIZE, VIDEO_SIZE, filmed, one_lap, view
from benchmark.runs.run import run
from benchmark.runs.run_folder import RunFolder
from benchmark.settings.run_spec import RunSpec
from leaderboard.identity import SMOKE_EPISODES
from tasks.task import EPISODE_S

PACKAGES = "apt-get install libegl1"
LAP_S = 2.0
SPEC = RunSpec(backend="mujoco", task="circle", algo="hold-still", steps=0, smoke=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run that trained nothing."""
    path = tmp_path_factory.mktemp("runs") / "still"
    run(SPEC, path, workers=1, resume=False, force=False)
    return path


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    """Two episodes of it."""
    return replay(SPEC, folder, episodes=2, workers=1)


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
    result = view([folder], out, "figure", {}, episodes=2, workers=1)
    assert result["written"] == str(out)
    assert result["episodes"] == 2
    assert [p.name for p in out.parent.iterdir()] == ["paths.png"]
    pixels = imread(out)
    blue = (pixels[..., 2] > 0.6) & (pixels[..., 0] < 0.5)
    assert red(pixels).sum() > 100
    assert blue.sum() > 20


def test_replay_gives_the_scores_of_the_run(folder: Path, tmp_path: Path) -> None:
    """Replay as many episodes as the smoke run has and find its scores again."""
    from benchmark.runs.run_folder import read_run

    result = view([folder], tmp_path / "all.png", "figure", {}, SMOKE_EPISODES, workers=1)
    scores = read_run(folder)["scores"]
    assert {name: result[name] for name in scores} == pytest.approx(scores)


def needs_opengl() -> None:
    if not any(opengl_works(platform) for platform in ("egl", "osmesa")):
        pytest.skip(f"no OpenGL without a screen here; {PACKAGES}")


def test_pictures_say_what_they_are(folder: Path, tmp_path: Path) -> None:
    """Write caption and command into the picture, and no folder of this machine."""
    out = tmp_path / "paths.png"
    view([folder], out, "figure", {"backend": "mujoco"}, episodes=1, workers=1)
    text = Image.open(out).text
    assert text["Title"].startswith("circle, mujoco, hold-still, 1 episode errors ")
    command = "bench view still --kind figure --backend mujoco --out paths.png"
    assert text["Source"] == command


def test_settings_are_drawn_and_named(folder: Path, tmp_path: Path) -> None:
    """Replay another figure, size, pace and stick as `bench eval` does, and say so on it."""
    out, options = tmp_path / "paths.png", ["--radius", "1cm", "--pace", "0.5", "--stick", "thin"]
    options += ["--task", "eight"]
    words = ["view", str(folder), *options, "--episodes", "1", "--out", str(out)]
    assert cli.call([*words, "--workers", "1"]) == 0
    text = Image.open(out).text
    title = " ".join(text["Title"].split())
    assert title.startswith("eight, mujoco, trained on circle, hold-still, 1 episode, thin stick")
    assert "radius 1 cm, 0.5 times the pace" in title
    assert "--task eight --stick thin --radius 1cm --pace 0.5" in text["Source"]


def test_recording_is_that_of_the_engine(recording: Recording) -> None:
    """Keep every step of the first episode, in order, and its touch as the state has it."""
    steps, step_s = round(EPISODE_S / 0.02), 0.02
    assert recording.time_s == pytest.approx(step_s * np.arange(1, steps + 1))
    assert recording.states.joint_rad.shape == recording.target_rad.shape == (steps, 6)
    assert (recording.first, recording.lap, recording.period) == (100, 100, 100)
    force = np.linalg.norm(recording.states.contact_force_n, axis=2)
    assert (recording.touch.in_contact <= (force > 0)).all()
    assert recording.touch.in_contact.mean() > 0.5
    half = recording.spec.stick.length_m / 2
    apart = np.linalg.norm(recording.lower_m[:, 0] - recording.states.stick_pos_m, axis=1)
    assert apart == pytest.approx(half, abs=1e-12)


def test_joints_are_drawn_over_the_second_lap(recording: Recording) -> None:
    """Draw target and measured angle of every driven joint in degrees, from 2 to 4 s."""
    axes = draw_joints(recording, "title").axes
    assert [a.get_title().split(",")[0] for a in axes] == ["J0", "J1", "J3", "J4", "J6", "J7"]
    for joint, one in enumerate(axes):
        target, measured = one.lines
        assert target.get_xdata()[[0, -1]] == pytest.approx([2.02, 4.0])
        drawn = np.radians([target.get_ydata(), measured.get_ydata()])
        lap = slice(100, 200)
        assert drawn[0] == pytest.approx(recording.target_rad[lap, joint])
        assert drawn[1] == pytest.approx(recording.states.measured_rad[lap, joint])


def test_touch_is_drawn_in_the_fingertip_frame(recording: Recording) -> None:
    """Draw contact positions in millimetres, gaps without contact, and the taxels of moments."""
    axes = draw_touch(recording, "title").axes
    touch = recording.touch
    for f, row in enumerate(np.reshape(axes, (3, -1))):
        drawn = np.array([line.get_ydata() for line in row[0].lines[:3]]).T
        there = touch.in_contact[100:, f]
        assert np.isnan(drawn[~there]).all()
        assert drawn[there] == pytest.approx(1e3 * touch.center_m[100:, f][there])
        (mesh,) = row[1].collections
        assert mesh.get_array().sum() == touch.active[100, f].sum()


def test_a_fall_ends_what_is_drawn(recording: Recording) -> None:
    """Draw joints and touch from the start to the fall where no full lap was held."""
    held = np.arange(len(recording.time_s))[:, None] < [50, 300]
    dropped = dataclasses.replace(recording, held=held)
    for axes in (draw_joints(dropped, "title").axes[0], draw_touch(dropped, "title").axes[0]):
        assert axes.lines[0].get_xdata()[[0, -1]] == pytest.approx([0.02, 1.0])


def test_hand_is_drawn(folder: Path, tmp_path: Path) -> None:
    """Draw the hand: a full picture, not all sky, with the red reference in it."""
    needs_opengl()
    out = tmp_path / "hand.png"
    result = view([folder], out, "hand", {}, time_s=0.5, workers=1)
    pixels = imread(out)
    assert pixels.shape[1::-1] == PICTURE_SIZE
    assert (pixels[..., :3].max(axis=2) < 0.4).mean() > 0.01
    assert red(pixels).sum() > 100
    assert not result["stick_has_fallen"]


def test_reference_and_taxels_move_with_the_frames(recording: Recording) -> None:
    """Draw another picture where only the reference, or only a taxel, is another.

    However far the stick's lower end has fallen.
    """
    needs_opengl()
    unseen = np.full((3, 3), 1000.0)
    still = {"spec": recording.spec, "states": recording.states.rows([0, 0, 0])}
    still |= {"lower_m": unseen, "first": 0, "size": (320, 240)}
    active = np.zeros((3, *recording.touch.active.shape[1:]), dtype=bool)
    active[2] = True
    reference = recording.reference_m[[0, 150, 150], 0]
    scene = _render.Scene(active=active, reference_m=reference, frames=(0, 1, 2, 1), **still)
    first, moved, touched, again = _render.render(scene)
    assert (first.max(axis=2) < 100).mean() > 0.01
    assert (first != moved).any() and (moved != touched).any()
    assert red(touched / 255).sum() > red(moved / 255).sum()
    assert (moved == again).all()


@pytest.mark.parametrize(("ending", "length_s"), [(".mp4", EPISODE_S), (".gif", LAP_S)])
def test_video_lasts_an_episode_or_a_lap(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, length_s: float
) -> None:
    """Film an episode in real time, or a lap that begins anew, and leave nothing but the video."""
    needs_opengl()
    for size in ("VIDEO_SIZE", "LOOP_SIZE"):
        monkeypatch.setattr(f"benchmark.pictures.view.{size}", (160, 128))
    monkeypatch.setattr("benchmark.pictures.view.EVERY", {ending: 25})
    out = tmp_path / f"video{ending}"
    result = view([folder], out, None, {}, workers=1)
    count = round(2.0 * length_s)
    assert (result["kind"], result["frames"], result["frames_per_s"]) == ("hand", count, 2.0)
    assert [p.name for p in tmp_path.iterdir()] == [out.name]
    about, *frames = imageio_ffmpeg.read_frames(str(out))
    assert about["size"] == (160, 128) and about["duration"] == pytest.approx(length_s, abs=0.51)
    assert len(frames) >= count and frames[0] != frames[-1]


def test_only_a_closed_figure_is_one_lap(recording: Recording) -> None:
    """Film the last lap where the reference comes back to itself, else the whole episode."""
    assert one_lap(recording, every=50) == (200, 250)
    away = np.linspace(0.0, 0.1, 300)[:, None, None]
    spiral = dataclasses.replace(recording, reference_m=recording.reference_m + away)
    assert one_lap(spiral, every=100) == (0, 100, 200)


def test_video_ends_after_a_fall(recording: Recording) -> None:
    """Film half a second beyond the fall, and no further."""
    held = np.arange(len(recording.time_s))[:, None] < [50, 300]
    dropped = dataclasses.replace(recording, held=held)
    assert filmed(dropped, every=5) == tuple(range(0, 75, 5))
    assert filmed(recording, every=100) == (0, 100, 200)


def test_video_size_suits_the_encoder() -> None:
    """Film in whole macroblocks, so that no frame is scaled."""
    assert all(side % 16 == 0 for side in (*VIDEO_SIZE, *LOOP_SIZE))


def test_missing_opengl_names_the_packages(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Say in one message what to install when no platform works."""
    monkeypatch.setattr(_render, "PLATFORMS", {"glx-less": "libegl1", "none": "libosmesa6"})
    with pytest.raises(CommandError, match=f"{PACKAGES} or apt-get install libosmesa6"):
        view([folder], tmp_path / "hand.png", "hand", {}, episodes=1, workers=1)
    assert not list(tmp_path.iterdir())


def trained(folder: Path, seed: int, reward: float) -> Path:
    """A run folder with a learning curve of five points."""
    spec = RunSpec(backend="mujoco", task="line", seed=seed, steps=2000)
    claimed = RunFolder(folder, spec)
    claimed.claim(resume=False, force=False)
    row = {"reward": reward, "p_err_cm": 1.0, "q_err_deg": 3.0, "dropped": float("nan")}
    claimed.write_progress([row | {"steps": n, "wall_s": 1.0} for n in range(400, 2001, 400)])
    return folder


def test_curves_of_seeds_are_one_band(tmp_path: Path) -> None:
    """Draw the mean over seeds, the least and the most, and name the count."""
    folders = [trained(tmp_path / f"s{n}", n, reward) for n, reward in enumerate((0.1, 0.2, 0.6))]
    reward = draw_curves(read_curves(folders), "title").axes[0]
    (line,), (band,) = reward.lines, reward.collections
    assert line.get_xdata().tolist() == [400, 800, 1200, 1600, 2000]
    assert line.get_ydata() == pytest.approx([0.3] * 5)
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((0.1, 0.6))
    assert line.get_label() == "mujoco, line, sb3-ppo, contact-centers (3 seeds)"
    out = tmp_path / "curve.png"
    assert view(folders, out, "curve", {})["curves"] == 1
    assert Image.open(out).text["Source"] == "bench view s0 s1 s2 --kind curve --out curve.png"


def test_a_run_without_a_curve_is_refused(folder: Path, tmp_path: Path) -> None:
    """Say that what does not train has no learning curve."""
    with pytest.raises(UsageError, match="still has no learning curve: hold-still was not trained"):
        view([folder], tmp_path / "x.png", "curve", {})


def test_several_runs_make_curves_only(folder: Path, tmp_path: Path) -> None:
    """Refuse to draw two runs in one figure."""
    with pytest.raises(UsageError, match="--kind figure draws one run, but 2 are given"):
        view([folder, folder], tmp_path / "x.png", None, {})


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--kind", "hnad"], "no kind of picture named 'hnad'; known: curve, figure, hand,"),
        (["--time", "1s"], "--kind hand"),
        (["--kind", "curve", "--episodes", "2"], "--kind curve replays nothing"),
        (["--kind", "hand", "--time", "7s"], "allowed: 0.02 to 6"),
        (["--episodes", "0"], "allowed: 1 to 100"),
        (["--backend", "mujco"], "Did you mean 'mujoco'?"),
    ],
)
def test_wrong_option_is_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture, options: list[str], says: str
) -> None:
    """Exit with 2 and say what is allowed."""
    out = tmp_path / "x.png"
    assert cli.call(["view", str(folder), "--out", str(out), *options]) == 2
    assert says in capfd.readouterr().err
    assert not out.exists()


def test_missing_run_and_wrong_file_are_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    """Exit with 2 for a folder that is not there, and for a file that is not a PNG."""
    missing = tmp_path / "missing"
    assert cli.call(["view", str(missing), "--out", str(tmp_path / "x.png")]) == 2
    assert f"no run folder at {missing}" in capfd.readouterr().err
    assert cli.call(["view", str(folder), "--out", str(tmp_path / "x.jpg")]) == 2
    assert "ending in .png" in capfd.readouterr().err
    film = ["view", str(folder), "--kind", "touch", "--out", str(tmp_path / "x.mp4")]
    assert cli.call(film) == 2
    assert "allowed with --kind touch: a name ending in .png" in capfd.readouterr().err
