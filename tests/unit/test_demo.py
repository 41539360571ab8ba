"""`bench demo`: what it ships, what it writes, and what it does without an engine or a screen."""

import json
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from matplotlib.image import imread

from benchmark.cli import app
from benchmark.demo import film
from benchmark.demo.demo import DATA, _draw, demo
from benchmark.demo.log import recorded
from benchmark.demo.plays import play
from benchmark.demo.texts import LOG
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.parts.registry import ROOT
from benchmark.pictures import _render
from benchmark.runs.run_folder import check_policy, read_run, run_spec
from diagnosis.logs.log import read_log

POLICY = DATA / "policy"
MOST_BYTES = 1_000_000


def test_shipped_policy_is_the_leaderboards() -> None:
    """Ship the very files that the leaderboard keeps of the policy."""
    run = read_run(POLICY)
    check_policy(POLICY, run)
    kept = ROOT / "leaderboard/policies" / run_spec(run).name
    for file in POLICY.iterdir():
        assert file.read_bytes() == (kept / file.name).read_bytes()


def test_shipped_log_is_what_its_maker_records() -> None:
    """Record the log again and read the same, but for rounding."""
    kept, again = read_log(DATA / LOG), recorded()
    assert kept.meta == again.meta
    assert kept.mjcf_xml == again.mjcf_xml
    assert np.abs(kept.samples - again.samples).to_numpy().max() < 1e-5


def test_data_are_small() -> None:
    """Ship less than a megabyte."""
    assert sum(file.stat().st_size for file in DATA.rglob("*") if file.is_file()) < MOST_BYTES


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few and small frames."""
    monkeypatch.setattr(film, "PANEL_SIZE", (160, 96))
    monkeypatch.setattr(film, "EVERY", 60)


@pytest.mark.usefixtures("small")
def test_demo_shows_engines_a_film_and_a_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    """Write all that it names, say it as one JSON object, and find what was hidden in the log."""
    monkeypatch.setattr("benchmark.demo.demo.EPISODES", 2)
    out = tmp_path / "demo"
    assert app.call(["demo", "--out", str(out), "--json"]) == 0
    said = json.loads(capfd.readouterr().out)
    assert [row["backend"] for row in said["engines"]] == list(registry.usual("backend"))
    home = next(row for row in said["engines"] if row["trained_here"])
    assert home["tracked"] > 0.6 and home["held"] == 1.0 and home["p_err_cm"] < 1.0
    assert (said["diagnosis"]["verdict"], said["diagnosis"]["joints"]) == (["backlash"], ["elbow"])
    assert said["diagnosis"]["magnitudes"][0]["value"] == pytest.approx(1.5, abs=0.05)
    assert all(Path(path).exists() for path in said["written"])
    assert len(said["next"]) == 3
    assert imread(out / "paths.png").ndim == 3
    if "hand.mp4" not in said["skipped"]:
        about, *frames = imageio_ffmpeg.read_frames(str(out / "hand.mp4"))
        shown = sum(row["status"] == "done" for row in said["engines"])
        assert about["size"] == (160 * shown, 128) and len(frames) == 5
        assert about["duration"] == pytest.approx(film.FILM_S, abs=0.1)
    with pytest.raises(UsageError, match="holds paths.png; choose another --out, or --force"):
        demo(out, force=False)


def test_a_missing_engine_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Say how to install an engine that is not there, in its row."""
    real = registry.load

    def missing(kind: str, name: str) -> object:
        if kind == "backend":
            raise CommandError(f"{kind} '{name}' is not installed")
        return real(kind, name)

    monkeypatch.setattr(registry, "load", missing)
    row = play(POLICY, "sapien", episodes=1).row()
    assert (row["status"], row["tracked"]) == ("skipped", None)
    assert row["reason"] == "backend 'sapien' is not installed"


@pytest.mark.usefixtures("small")
def test_without_a_renderer_the_film_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Draw the paths, and say why there is no film and what would mend it."""
    monkeypatch.setattr(_render, "PLATFORMS", {"glx-less": "libegl1", "none": "libosmesa6"})
    skipped = _draw([play(POLICY, "bullet", episodes=1)], tmp_path)
    assert list(skipped) == ["hand.mp4"] and "apt-get install libegl1" in skipped["hand.mp4"]
    assert [path.name for path in tmp_path.iterdir()] == ["paths.png"]
