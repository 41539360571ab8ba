"""`bench view LOG --live`: a log beside its worlds, with no screen and no browser."""

import dataclasses
import json
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

from backends.kinematics import body_frames
from benchmark.cli import app as cli
from benchmark.gap.overlay import CORRECTED, NOMINAL, Overlay, read_overlay
from diagnosis import diagnose, read_log
from diagnosis.replay.nominal import mjcf_world

LOG = Path(__file__).parents[2] / "benchmark" / "demo" / "data" / "elbow-log"


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the diagnosis of the log, as `bench diagnose` writes it."""
    folder = tmp_path_factory.mktemp("answer")
    found = diagnose(read_log(LOG))
    said = {"nominal": {"effects": "none"}, "sentence": found.sentences[0]}
    (folder / "diagnosis.json").write_text(json.dumps(found.plain() | said))
    return folder


@pytest.fixture(scope="module")
def overlay(answer: Path) -> Overlay:
    """The log beside its worlds."""
    return read_overlay(LOG, answer)[0]


def _off(overlay: Overlay, world: str) -> float:
    return float(np.sqrt(np.nanmean((overlay.measured - overlay.worlds[world]) ** 2)))


def test_the_corrected_world_moves_as_was_measured(overlay: Overlay) -> None:
    """Come, with what a diagnosis found, ten times nearer to the log than the nominal world."""
    assert _off(overlay, CORRECTED) < _off(overlay, NOMINAL) / 10


def test_the_slider_moves_three_robots(overlay: Overlay) -> None:
    """Serve a page; pose each robot by its own angles, and draw the residuals of its episode."""
    pytest.importorskip("viser")
    from benchmark.pictures.live_log import LiveLog

    live = LiveLog(overlay, "an elbow", port=0)
    assert b"<html" in urlopen(live.url).read().lower()
    moment = int(np.nanargmax(np.abs(overlay.measured - overlay.worlds[NOMINAL])))
    live.show(moment)
    angles = {"measured": overlay.measured, **overlay.worlds}
    assert set(angles) == {"measured", NOMINAL, CORRECTED}
    for name, angle in angles.items():
        half = angle[moment, 0] / 2
        assert np.allclose(live.nodes[f"{name}/forearm"].wxyz, [np.cos(half), 0, np.sin(half), 0])
    rows = overlay.episode == overlay.episode[moment]
    time_s, nominal, corrected = live.residuals.data
    assert np.array_equal(time_s, overlay.time_s[rows])
    assert np.abs(nominal).max() > 10 * np.abs(np.median(corrected))
    live.server.stop()


def test_a_log_without_a_diagnosis_is_shown_nominal(tmp_path: Path, monkeypatch) -> None:
    """Say how to get the corrected robot, and refuse a folder that has no diagnosis."""
    monkeypatch.chdir(tmp_path)
    found, said = read_overlay(LOG, None)
    assert set(found.worlds) == {NOMINAL} and said == f"no diagnosis yet: bench diagnose {LOG}"
    assert cli.call(["view", str(LOG), "--live", "--diagnosis", "absent"]) == 2


def test_a_slide_moves_along_its_axis() -> None:
    """Shift the frame of a slide, and turn it no way."""
    hand = mjcf_world(read_log(LOG)).hand
    (body,) = hand.bodies
    slide = dataclasses.replace(body.joint, slides=True)
    hand = dataclasses.replace(hand, bodies=(dataclasses.replace(body, joint=slide),))
    origin, rotation = body_frames(hand, np.array([[0.0], [0.1]]))["forearm"]
    assert np.allclose(origin[1] - origin[0], [0, 0.1, 0]) and np.allclose(rotation, np.eye(3))
