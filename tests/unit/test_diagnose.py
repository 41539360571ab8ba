"""`bench diagnose`: what it finds, says and refuses."""

import json
import os
import shlex
import shutil
import signal
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from tempfile import TemporaryFile

import pandas as pd
import pytest
import yaml
from diagnosis_logs import arm_log, hand_log

from backends import trx
from backends.catalogue import catalogue
from backends.sticks import STICKS
from benchmark import console
from benchmark.cli import app as cli
from benchmark.console import Bar
from benchmark.errors import UsageError
from benchmark.gap._diagnosis_texts import effects_text
from benchmark.settings.effects import parse_effects, read_effects
from diagnosis.logs.log import write_log
from diagnosis.verdict.result import Cause

IDEAL = trx.spec(STICKS["reference"])
KEYS = {
    "verdict",
    "joints",
    "magnitudes",
    "confidence",
    "ranking",
    "indistinguishable",
    "where",
    "gap_before",
    "gap_after",
    "noise_floor",
    "shrinkage",
    "cpu_s",
}
"""What DESIGN.md promises."""


def with_effects(text: str):
    """The ideal hand with effects."""
    spec = IDEAL
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    """The beginning of a log of steps with one degree of play on J3."""
    folder = hand_log(tmp_path_factory.mktemp("logs") / "play", "backlash=1deg@J3", "steps")
    frame = pd.read_parquet(folder / "samples.parquet")
    frame.head(len(frame) // 2).to_parquet(folder / "samples.parquet")
    return folder


@pytest.fixture(scope="module")
def diagnosed(log) -> tuple[dict, Path, str]:
    """What the command says of it, the folder it writes, and what it prints beside."""
    out, beside, kept = log.parent / "out", StringIO(), os.dup(1)
    words = ["diagnose", str(log), "--out", str(out), "--json", "--nominal", "bullet"]
    with TemporaryFile() as said, redirect_stderr(beside):
        os.dup2(said.fileno(), 1)
        try:
            assert cli.call(words) == 0
        finally:
            os.dup2(kept, 1)
            os.close(kept)
        said.seek(0)
        return json.load(said), out, beside.getvalue()


def test_hidden_play_is_found(diagnosed):
    """Name effect and joint, and the size to five percent: play that rattles blurs it."""
    found = diagnosed[0]
    assert found["verdict"] == ["backlash"] and found["joints"] == ["J3"]
    assert found["magnitudes"][0]["value"] == pytest.approx(1.0, rel=0.05)
    assert found["gap_after"] < found["gap_nominal"] < found["gap_before"]


def test_the_json_object_keeps_its_promise(diagnosed):
    """Give every promised key, the same in diagnosis.json, and progress elsewhere."""
    found, out, beside = diagnosed
    assert found.keys() >= KEYS
    kept = json.loads((out / "diagnosis.json").read_text())
    assert {key: kept[key] for key in found} == found
    assert "diagnose play 100/100" in beside
    assert all(f"--out {out}-corrected" in one for one in found["next"] if "diagnose" in one)


def test_the_compiled_replay_is_the_engine(diagnosed):
    """Report a difference far under a floor between the engine and what was replayed."""
    assert diagnosed[0]["nominal"]["replay_apart_rad"] < 1e-4


def test_the_corrected_world_is_confirmed_in_the_engine(diagnosed):
    """Replay all of the log on the nominal engine; give the gap that is left in JSON and page."""
    found, out, _ = diagnosed
    before, after = found["engine_gaps_rad"]
    assert 0.0 < after < 0.5 * before
    assert "corrected gap in the engine" in (out / "report.html").read_text()


def test_the_effects_to_add_are_the_real_world(diagnosed):
    """Write effects that give the real world's numbers, the play to three percent."""
    corrected, real = with_effects(diagnosed[0]["effects"]), with_effects("backlash=1deg@J3")
    play = [d.play_rad for d in corrected.drives], [d.play_rad for d in real.drives]
    assert play[0] == pytest.approx(play[1], rel=0.05)


def test_the_next_policy_trains_in_the_nominal_engine(diagnosed):
    """Offer the corrected world in the engine that was asked for."""
    train = f"bench run --backend bullet --task circle --effects {diagnosed[0]['effects']}"
    assert train in diagnosed[0]["next"]


def test_what_is_known_is_not_found_again(log, tmp_path, capfd):
    """Say none where the nominal world has the effect."""
    words = ["diagnose", str(log), "--out", str(tmp_path / "out"), "--json"]
    assert cli.call([*words, "--known-effects", "backlash=1deg@J3"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["none"]
    assert found["effects"] is None and found["magnitudes"] == []


def test_a_users_own_arm(tmp_path, capfd):
    """Diagnose an MJCF mechanism, and offer no command that takes a hand alone."""
    write_log(arm_log("coulomb-friction=100mNm@elbow"), tmp_path / "my arm", "csv")
    words = ["diagnose", str(tmp_path / "my arm"), "--out", str(tmp_path / "out")]
    assert cli.call([*words, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"] and found["joints"] == ["elbow"]
    low, high = found["magnitudes"][0]["interval"]
    assert found["magnitudes"][0]["value"] == pytest.approx(100, abs=max(high - low, 0.3))
    (command,) = found["next"]
    assert shlex.split(command)[1:3] == words[:2]


def test_ctrl_c_keeps_what_is_known(tmp_path, monkeypatch, capfd):
    """Write what was found by the first Ctrl-C, say so, and end as interrupted."""
    write_log(arm_log("coulomb-friction=100mNm@elbow"), tmp_path / "log", "csv")
    update = Bar.update

    def pressed(bar: Bar, done: int, note: str = "") -> None:
        if note == "what is left":
            signal.raise_signal(signal.SIGINT)
        update(bar, done, note)

    monkeypatch.setattr(Bar, "update", pressed)
    before = signal.signal(signal.SIGINT, console.stop)
    try:
        words = ["diagnose", str(tmp_path / "log"), "--out", str(tmp_path / "out")]
        assert cli.call(words) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    assert "stopped; known so far: coulomb-friction" in capfd.readouterr().err
    kept = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert kept["stopped"] and kept["verdict"] == ["coulomb-friction"]
    assert "Stopped before its end" in (tmp_path / "out" / "report.html").read_text()


def changed(source: Path, target: Path, meta=None, samples=None) -> Path:
    """A copy of a log with its log.yaml and samples changed."""
    shutil.copytree(source, target)
    if meta is not None:
        data = yaml.safe_load((target / "log.yaml").read_text())
        (target / "log.yaml").write_text(yaml.safe_dump(data | meta))
    if samples is not None:
        frame = samples(pd.read_parquet(target / "samples.parquet"))
        frame.to_parquet(target / "samples.parquet")
    return target


def still(frame: pd.DataFrame) -> pd.DataFrame:
    """The samples with nothing moving."""
    moving = [c for c in frame if c.startswith(("command", "position"))]
    return frame.assign(**{c: frame[c].iloc[0] for c in moving})


BAD = {
    "rest": ({"samples": still}, "nothing moves in this log"),
    "short": (
        {"samples": lambda f: f.head(60)},
        "0.295 s in free air in episodes of 20 samples or more",
    ),
    "brief": (
        {"samples": lambda f: f.head(381)},
        "1.9 s in free air in episodes of 20 samples or more, allowed: from 2 s; record steps",
    ),
    "shorter": ({"samples": lambda f: f.head(9)}, "has 9 samples; needed: at least 20"),
    "grasp": (
        {"meta": {"episodes": [{"episode": 0, "protocol": "grasp"}]}},
        "not identifiable from this log: 0 s in free air",
    ),
    "joint": (
        {"samples": lambda f: f[[c for c in f if not c.endswith(".J3")]]},
        "no commands for J3; it has: J0, J1, J4, J6, J7; record every joint",
    ),
    "hand": ({"meta": {"mechanism": {"hand": "allegro"}}}, "no hand named 'allegro'; known: trx"),
    "stick": (
        {"meta": {"mechanism": {"hand": "trx", "stick": "oak"}}},
        "no stick named 'oak'; known: fabric, reference",
    ),
    "effects": (
        {"meta": {"mechanism": {"hand": "trx", "effects": "backlsh=1deg"}}},
        "Did you mean 'backlash'?",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_logs_give_one_message(log, tmp_path, capfd, case):
    """Refuse what says nothing: the reason, what to do, exit code 2, nothing written."""
    change, words = BAD[case]
    bad = changed(log, tmp_path / case, **change)
    assert cli.call(["diagnose", str(bad), "--out", str(tmp_path / "out")]) == 2
    out, err = capfd.readouterr()
    assert words in err
    assert "Traceback" not in err and "WARNING" not in err and out == ""
    assert not (tmp_path / "out").exists()


def test_what_is_no_log_gives_one_message(log, tmp_path, capfd):
    """Refuse a folder without a log, a file that is incomplete, and an unknown engine."""
    cut = changed(log, tmp_path / "cut")
    data = (cut / "samples.parquet").read_bytes()
    (cut / "samples.parquet").write_bytes(data[: len(data) // 2])
    for words, said in (
        ([str(tmp_path / "absent")], "no log folder"),
        ([str(cut)], "is incomplete"),
        ([str(log), "--nominal", "mujoc"], "Did you mean 'mujoco'?"),
        ([str(log), "--known-effects", "backlash=99deg"], "out of range; allowed: 0 to 10 deg"),
    ):
        assert cli.call(["diagnose", *words, "--out", str(tmp_path / "out")]) == 2
        assert said in capfd.readouterr().err


def test_a_diagnosis_is_not_replaced_unasked(diagnosed, log, capfd):
    """Keep what a folder holds unless --force is given."""
    assert cli.call(["diagnose", str(log), "--out", str(diagnosed[1])]) == 2
    assert "--force to replace it" in capfd.readouterr().err


def test_joints_that_do_nothing_are_named(log, tmp_path, capfd):
    """Judge the fingers that move, and say of the others that this log shows nothing of them."""

    def one_finger(frame: pd.DataFrame) -> pd.DataFrame:
        rest = [c for c in frame if c.startswith(("command", "position")) and "J3" not in c]
        return frame.assign(**{c: frame[c].iloc[0] for c in rest if "J4" not in c})

    quiet = changed(log, tmp_path / "quiet", samples=one_finger)
    assert cli.call(["diagnose", str(quiet), "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["backlash"]
    assert any("J0, J1" in text and "shows nothing" in text for text in found["notes"])


def finding(effect: str, value: float, unit: str, *joints: str) -> Cause:
    """A cause on some joints."""
    joint = joints[0] if len(joints) == 1 else None
    size = {"value": value, "low": value, "high": value, "unit": unit, "share": 1.0}
    return Cause(effect=effect, joint=joint, joints=joints, **size)


@pytest.mark.parametrize(
    ("known", "found", "text"),
    [
        ("none", finding("backlash", 0.5, "deg", "J3"), "backlash=0.5deg@J3"),
        ("none", finding("backlash", 0.5, "deg", "J0", "J3", "J6"), "backlash=0.5deg"),
        ("none", finding("kp-scale", -10, "%", "J3", "J4"), "kp-scale=-10%@J3,kp-scale=-10%@J4"),
        ("none", finding("gravity-tilt", 2, "deg", "J0", "J1"), "gravity-tilt=2deg"),
        ("built", finding("backlash", 0.5, "deg", "J3"), "built,backlash=0.5deg@J3"),
        (
            "built",
            finding("backlash", 0.5, "deg", "J0", "J3", "J6"),
            "backlash=1.5deg,self-lock=10Nm",
        ),
        ("kp-scale=-10%@J3", finding("kp-scale", 20, "%", "J3"), "kp-scale=8%@J3"),
    ],
)
def test_effects_are_added_to_those_known(known, found, text):
    """Write the world that has both: the known effects first, then what was found."""
    assert effects_text(read_effects(known, IDEAL.hand), [found], IDEAL, catalogue()) == text
    both = with_effects(known)
    alone = effects_text(read_effects("none", IDEAL.hand), [found], IDEAL, catalogue())
    for item in alone.split(","):
        for effect in parse_effects(item, IDEAL.hand):
            both = effect.on_spec(both)
    written = with_effects(text)
    for ours, wanted in zip(written.drives, both.drives, strict=True):
        assert ours.play_rad == pytest.approx(wanted.play_rad)
        assert ours.kp_nm_rad == pytest.approx(wanted.kp_nm_rad)
    assert written.gravity_m_s2 == pytest.approx(both.gravity_m_s2)


def test_a_sum_out_of_range_is_refused():
    """Refuse a corrected world that no effect can write."""
    found = finding("backlash", 6, "deg", "J0", "J3", "J6")
    known = read_effects("backlash=6deg", IDEAL.hand)
    with pytest.raises(UsageError, match="out of range; allowed: 0 to 10 deg"):
        effects_text(known, [found], IDEAL, catalogue())
