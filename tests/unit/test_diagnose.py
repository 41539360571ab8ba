"""`bench diagnose`: what it finds, says and refuses."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from diagnosis_logs import arm_log, hand_log

from backends import trx
from backends.sticks import STICKS
from benchmark import diagnose, registry
from benchmark._diagnosis_texts import effects_text
from benchmark.cli import app as cli
from benchmark.effects import parse_effects
from benchmark.errors import UsageError
from diagnosis.attribution.experiments import told_of
from diagnosis.attribution.gather import gather
from diagnosis.attribution.locate import _interval
from diagnosis.attribution.magnitudes import Magnitude, merge
from diagnosis.attribution.rules import rules
from diagnosis.diagnose import _confidence, gap, judge_limb, shrinkage
from diagnosis.logs.log import LogError, make_log, read_log, write_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.replay import replay

IDEAL = trx.spec(STICKS["reference"])
FLOOR = {"position": 3e-4, "motor": 3e-4, "torque": 5e-3}
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
    """A log of steps with one degree of play on J3."""
    return hand_log(tmp_path_factory.mktemp("logs") / "play", "backlash=1deg@J3", "steps")


@pytest.fixture(scope="module")
def told(log) -> tuple[dict, Path, str]:
    """What the command says of it, the folder it writes, and what it prints beside."""
    out = log.parent / "out"
    words = ["diagnose", str(log), "--out", str(out), "--workers", "1", "--json"]
    words += ["--nominal", "bullet"]
    code = (
        "import sys; from benchmark.cli.app import main; sys.argv[1:] = " + repr(words) + "; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout), out, done.stderr


def test_hidden_play_is_found(told):
    """Name effect and joint, and the magnitude within what the model takes as nothing."""
    found = told[0]
    assert found["verdict"] == ["backlash"] and found["joints"] == ["J3"]
    floor_deg = np.degrees(rules().floor_position_rad)
    assert found["magnitudes"][0]["value"] == pytest.approx(1.0, abs=floor_deg)
    assert found["gap_after"] < found["gap_nominal"] < found["gap_before"]


def test_the_json_object_keeps_its_promise(told):
    """Give every promised key, the same in diagnosis.json, and progress elsewhere."""
    found, out, beside = told
    assert found.keys() >= KEYS
    kept = json.loads((out / "diagnosis.json").read_text())
    assert {key: kept[key] for key in found} == found
    assert kept["rules"]["version"] == rules().version
    assert "diagnose play 3/3" in beside


def test_the_compiled_replay_is_the_engine(told):
    """Report a difference far under a floor between the engine and what was replayed."""
    assert told[0]["nominal"]["replay_apart_rad"] < 1e-4


def test_the_effects_to_add_are_the_real_world(told):
    """Write effects that give the real world's numbers, the play within the floor."""
    corrected, real = with_effects(told[0]["effects"]), with_effects("backlash=1deg@J3")
    play = [d.play_rad for d in corrected.drives], [d.play_rad for d in real.drives]
    assert play[0] == pytest.approx(play[1], abs=rules().floor_position_rad)


def test_the_next_policy_trains_in_the_nominal_engine(told):
    """Offer the corrected world in the engine that was asked for."""
    train = f"bench run --backend bullet --task circle --effects {told[0]['effects']}"
    assert train in told[0]["next"]


def test_what_is_known_is_not_found_again(log, tmp_path, capfd):
    """Say none where the nominal world has the effect."""
    words = ["diagnose", str(log), "--out", str(tmp_path / "out"), "--workers", "1", "--json"]
    assert cli.call([*words, "--known-effects", "backlash=1deg@J3"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["none"]
    assert found["effects"] is None and found["magnitudes"] == []


def test_a_users_own_arm(tmp_path, capfd):
    """Diagnose an MJCF mechanism, and offer no command that takes a hand alone."""
    write_log(arm_log("coulomb-friction=100mNm@elbow"), tmp_path / "arm", "csv")
    words = ["diagnose", str(tmp_path / "arm"), "--out", str(tmp_path / "out"), "--workers", "1"]
    assert cli.call([*words, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"] and found["joints"] == ["elbow"]
    low, high = found["magnitudes"][0]["interval"]
    assert found["magnitudes"][0]["value"] == pytest.approx(100, abs=max(high - low, 0.3))
    assert [command.split()[1] for command in found["next"]] == ["diagnose"]


@pytest.fixture(scope="module")
def gains(tmp_path_factory) -> list[str]:
    """Logs of one arm with friction under two gains."""
    folders = []
    for gain in (1.0, 0.5):
        folder = tmp_path_factory.mktemp("gains") / f"gain{gain}"
        write_log(arm_log("coulomb-friction=100mNm@elbow", ("steps",), gain), folder, "csv")
        folders.append(str(folder))
    return folders


@pytest.mark.slow
def test_settings_judge_each_other(gains, tmp_path, capfd):
    """Fit under one gain, judge under another, and name the friction of both."""
    words = ["diagnose", *gains, "--judge", gains[1], "--workers", "1"]
    assert cli.call([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"] and found["joints"] == ["elbow"]
    assert found["magnitudes"][0]["value"] == pytest.approx(100, rel=0.02)
    assert found["gap_before"] > 3 * found["gap_after"]
    assert found["log"] == f"{gains[0]} {gains[1]} --judge {gains[1]}"
    assert "diagnose each log by itself" in found["missing"][0]
    assert (tmp_path / "out" / "report.html").exists()


def test_settings_that_cannot_judge_are_refused(gains, log, tmp_path, capfd):
    """Say in one line which logs may judge, and that they are of one mechanism."""
    one, other = gains
    for words, said in (
        ([one, other], "--judge names none of them; name the log on which"),
        ([one, other, "--judge", str(log)], "is not among the logs"),
        ([one, "--judge", one], "leave at least one for fitting"),
        ([one, one, "--judge", one], "is given twice"),
        ([one, str(log), "--judge", one], "of different joints"),
    ):
        assert cli.call(["diagnose", *words, "--out", str(tmp_path / "out")]) == 2
        err = " ".join(capfd.readouterr().err.split())
        assert said in err and "Traceback" not in err


def test_a_sound_hand_is_as_sure_as_its_least_sure_finger():
    """Hold `none` of many limbs no less likely than of the worst, and believe one that accuses."""
    log = arm_log("", ("steps",))
    part = gather(log, mjcf_world(log), FLOOR)[0]
    sound = judge_limb(part, catalogue={}, uncertainty=0.05).verdict
    assert sound.names == ("none",)
    worse = dataclasses.replace(sound, lead_nats=0.5)
    assert sound.confidence > worse.confidence == _confidence([sound, worse, sound], ())
    strange = dataclasses.replace(sound, names=("unknown",), lead_nats=500.0)
    assert _confidence([worse, strange], ()) == strange.confidence
    accused = dataclasses.replace(sound, names=("kp-scale",), lead_nats=50.0)
    assert _confidence([worse, strange, accused, accused], ()) == accused.confidence
    other = dataclasses.replace(sound, names=("backlash",), lead_nats=50.0)
    assert _confidence([accused, other], ()) == pytest.approx(accused.confidence**2)


def test_a_log_faster_than_the_drive_is_judged(tmp_path):
    """Judge a log with four rows in every drive period; refuse 22 periods of it."""
    slow = arm_log("", ("steps",))
    world = mjcf_world(slow)
    (part,) = gather(slow, world, FLOOR)
    told, period_s = part.recordings[0].commands, world.timing.drive_s
    ticks = np.arange(round(3.0 / period_s))
    rows = np.searchsorted(told.ticks, ticks, side="right") - 1
    every = dataclasses.replace(told, ticks=ticks, target=told.target[rows], load=told.load[rows])
    time_s = np.arange(0.0, 2.9, period_s / 4)
    now = np.round(time_s / period_s).astype(int)
    read = replay(world, every)[0][now] + np.random.default_rng(0).normal(0, 1e-4, (len(now), 2))
    frame = pd.DataFrame({"episode": 0, "t_s": time_s})
    for j, name in enumerate(part.joints):
        frame[f"command_rad.{name}"] = every.target[now, j]
        frame[f"position_rad.{name}"] = read[:, j]
    meta = slow.meta.model_copy(update={"channels": {}})
    brief = make_log(meta, frame[:90], slow.mjcf_xml)
    write_log(brief, tmp_path / "brief")
    with pytest.raises(LogError, match="100 samples or more, one per drive period"):
        gather(read_log(tmp_path / "brief"), world, FLOOR)
    (fast,) = gather(make_log(meta, frame, slow.mjcf_xml), world, FLOOR)
    assert (np.diff(fast.recordings[0].commands.ticks) == 1).all()
    assert judge_limb(fast, catalogue={}, uncertainty=0.05).verdict.names == ("none",)


@pytest.mark.parametrize(
    ("cores", "limbs", "started"), [(1, 3, 1), (2, 3, 3), (2, 2, 2), (2, 8, 3), (16, 3, 3)]
)
def test_no_core_idles_while_the_last_limb_is_judged(cores, limbs, started):
    """Start one process more than there are cores, and no more than limbs; on one core one."""
    assert diagnose.processes(cores, limbs) == started


@pytest.mark.slow
def test_limbs_side_by_side_give_the_same():
    """Judge on two cores as on one, and count the CPU time of the processes."""
    log = arm_log("coulomb-friction=100mNm@elbow", ("steps",))
    part = gather(log, mjcf_world(log), FLOOR)[0]
    known = {"coulomb-friction": registry.load("effect", "coulomb-friction")}
    judge = partial(judge_limb, catalogue=known, uncertainty=0.05)
    before = os.times()
    one, two = diagnose._side_by_side("two", 2)(judge, [part, part])
    after = os.times()
    alone = judge(part)
    for found in (one, two):
        assert found.verdict.names == alone.verdict.names
        assert found.verdict.chosen.fit.cost == alone.verdict.chosen.fit.cost
    assert after.children_user > before.children_user


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
    "rest": ({"samples": still}, "not identifiable from this log: no joint moves"),
    "short": ({"samples": lambda f: f.head(60)}, "no free-air episode of 100 samples"),
    "brief": (
        {"samples": lambda f: f.head(400)},
        "2.0 s in free air, allowed: from 2.5 s; record steps",
    ),
    "shorter": ({"samples": lambda f: f.head(9)}, "has 9 samples; needed: at least 20"),
    "grasp": (
        {"meta": {"episodes": [{"episode": 0, "protocol": "grasp"}]}},
        "not identifiable from this log: no free-air episode",
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
    assert cli.call(["diagnose", str(bad), "--out", str(tmp_path / "out"), "--workers", "1"]) == 2
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


def test_shares_of_no_gap_are_numbers():
    """Give a share of 0 where resampled blocks hold no gap: much of a log may be in order."""
    low, high = _interval(np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 1.0]]), np.random.default_rng(0))
    assert (low == 0).all() and high == pytest.approx([0.75, 0.25])


def test_a_diagnosis_is_not_replaced_unasked(told, log, capfd):
    """Keep what a folder holds unless --force is given."""
    assert cli.call(["diagnose", str(log), "--out", str(told[1])]) == 2
    assert "--force to replace it" in capfd.readouterr().err


def test_joints_that_do_nothing_are_named(log):
    """Tell of the joints that move, and not of a finger at rest."""
    whole = read_log(log)
    catalogue = {name: registry.load("effect", name) for name in registry.names("effect")}
    parts = gather(whole, IDEAL, FLOOR)
    assert told_of(parts[0], catalogue) == ("J0", "J1")
    quiet = read_log(changed(log, log.parent / "quiet", samples=still))
    assert told_of(gather(quiet, IDEAL, FLOOR)[0], catalogue) == ()


def finding(effect: str, value: float, unit: str, *joints: str) -> Magnitude:
    """A finding on some joints."""
    joint = joints[0] if len(joints) == 1 else None
    return Magnitude(
        effect=effect, joint=joint, value=value, unit=unit, interval=(value, value), joints=joints
    )


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
    assert effects_text(known, [found], IDEAL) == text
    both = with_effects(known)
    for item in effects_text("none", [found], IDEAL).split(","):
        for effect in parse_effects(item, IDEAL.hand):
            both = effect.on_spec(both)
    written = with_effects(text)
    for ours, wanted in zip(written.drives, both.drives, strict=True):
        assert ours.play_rad == pytest.approx(wanted.play_rad)
        assert ours.kp_nm_rad == pytest.approx(wanted.kp_nm_rad)
    assert written.gravity_m_s2 == pytest.approx(both.gravity_m_s2)


def test_a_sum_out_of_range_is_refused():
    """Refuse a corrected world that no effect can write."""
    with pytest.raises(UsageError, match="out of range; allowed: 0 to 10 deg"):
        effects_text("backlash=6deg", [finding("backlash", 6, "deg", "J0", "J3", "J6")], IDEAL)


def test_shrinkage_is_of_the_excess_over_the_floor():
    """Give 1 where the gap falls to the noise, a half where half of the excess is left."""
    rng = np.random.default_rng(0)
    noise = rng.normal(size=5000) ** 2
    before = 101 * np.ones(5000)
    assert shrinkage(before, 51 * np.ones(5000)).value == 0.5
    whole = shrinkage(before, np.minimum(noise, 1.0))
    assert whole.value == 1.0 and whole.interval == (1.0, 1.0)
    measured = gap(4 * noise)
    assert measured.interval[0] < 2.0 < measured.interval[1]
    assert shrinkage(before[:7], before[:7]).value == 0.0


def lock(joint: str, value: float, low: float, high: float) -> Magnitude:
    """A lock found on a joint."""
    return Magnitude(
        effect="self-lock",
        joint=joint,
        value=value,
        unit="Nm",
        interval=(low, high),
        joints=(joint,),
    )


LOCKED, FIRM = (0.6, 0.56, 100.0), (4.8, 0.5, 100.0)
"""Locks that held every load of a log: value and interval [Nm]."""


@pytest.mark.parametrize(
    ("found", "value", "interval"),
    [
        ((LOCKED, FIRM), 4.8, (0.56, 100.0)),
        ((LOCKED, FIRM, (0.9, 0.7, 1.1)), 0.9, (0.7, 1.1)),
        (((0.9, 0.8, 1.2), (0.9, 0.8, 1.2)), 0.9, (0.76, 1.04)),
    ],
)
def test_a_lock_that_held_agrees_with_any_larger_one(found, value, interval):
    """Take the largest of unbounded locks, the bounded one beside these, and weigh bounded ones."""
    (merged,) = merge([lock(f"J{k}", *one) for k, one in enumerate(found)])
    assert merged.value == pytest.approx(value)
    assert merged.interval == pytest.approx(interval, abs=0.02)
    assert merged.joints == tuple(f"J{k}" for k in range(len(found)))
