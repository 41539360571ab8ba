"""Logs without a model: what differs from healthy logs of the same motion, by group."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from arms import Real, log_of

from benchmark.cli import app as cli
from diagnosis.compare import (
    DELAY,
    GAIN,
    LESS,
    LOCAL,
    MORE,
    NONE,
    PLAY,
    SENSOR,
    UNKNOWN,
    compare,
)
from diagnosis.logs.log import Log, LogError, LogMeta, make_log, write_log

SCREW = Path(__file__).resolve().parents[3] / "shared/real_logs/cranfield_20kgf"
STROKES, HZ, HEALTHY = 4, 50, 6


def screw(seed: int, drag_n: float = 0.0, hunting_m: float = 0.0, ripple_n: float = 0.0) -> Log:
    """A ball screw that goes out and back, with a readout of its force: by formulas, no engine."""
    rng = np.random.default_rng(seed)
    t = np.arange(4 * HZ) / HZ
    command = 0.1 * np.interp(t, [0.5, 1.5, 2.5, 3.5], [0, 1, 1, 0])
    speed = np.gradient(command, t)
    moving = np.abs(speed) > 0
    damage = ripple_n * np.exp(-(((command - 0.05) / 0.002) ** 2)) * moving
    frames = []
    for stroke in range(STROKES):
        wander = np.convolve(rng.standard_normal(len(t)), np.ones(5) / 5, "same")
        position = command - 0.01 * speed + (2e-5 + hunting_m) * wander
        force = 20 * speed + (3 + drag_n) * np.sign(speed) + damage * np.sign(speed)
        frames.append(
            pd.DataFrame(
                {
                    "episode": stroke,
                    "t_s": t,
                    "command_m.screw": command,
                    "position_m.screw": position + 1e-6 * rng.standard_normal(len(t)),
                    "torque_n.screw": force + 0.1 * rng.standard_normal(len(t)),
                }
            )
        )
    return make_log(LogMeta(schema=1, source="a test"), pd.concat(frames))


@pytest.fixture(scope="module")
def screws() -> list[Log]:
    """Healthy ball screws."""
    return [screw(seed) for seed in range(HEALTHY)]


@pytest.fixture(scope="module")
def arms() -> list[Log]:
    """Healthy arms."""
    return [log_of(Real(joints=2), seed=seed) for seed in range(HEALTHY)]


@pytest.mark.parametrize(
    ("fault", "group"),
    [
        ({}, NONE),
        ({"drag_n": 1.0}, MORE),
        ({"drag_n": -1.0}, LESS),
        ({"drag_n": 1.0, "hunting_m": 1e-4}, MORE),
        ({"hunting_m": 1e-4}, PLAY),
        ({"hunting_m": 1e-4, "drag_n": -1.0}, PLAY),
        ({"ripple_n": 3.0}, LOCAL),
    ],
)
def test_a_screw_says_what_changed(fault, group, screws):
    """Tell friction, play and a damaged place apart by force and repetition."""
    (found,) = compare(screw(99, **fault), screws)
    assert found.group == group
    if group == LOCAL:
        assert found.place == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize(
    ("real", "groups"),
    [
        (Real(joints=2), (NONE, NONE)),
        (Real(joints=2, coulomb_nm={1: 0.5}), (None, MORE)),
        (Real(joints=2, kp={0: 0.7}), (GAIN, None)),
        (Real(joints=2, delay_s=0.01), (DELAY, DELAY)),
        (Real(joints=2, noise_rad=1e-3), (SENSOR, SENSOR)),
        (Real(joints=2, spring_nm_rad3=30.0), (UNKNOWN, None)),
    ],
)
def test_an_arm_says_what_changed(real, groups, arms):
    """Name delay, gain, friction and noise at their joints; what only pulls at another is said."""
    found = compare(log_of(real, seed=50), arms)
    for one, group in zip(found, groups, strict=True):
        assert one.group == group if group else one.group == NONE or one.pulled


def test_a_repetition_may_lack_a_sample(screws):
    """Compare what all repetitions have, where a clock drops the last sample of one."""
    today = screw(99)
    short = today.samples.drop(index=2 * 4 * HZ - 1)
    (found,) = compare(make_log(today.meta, short), screws)
    assert found.group == NONE


@pytest.mark.skipif(not SCREW.exists(), reason="the recordings of the ball screw are not here")
def test_a_real_screw_says_what_changed():
    """Accuse no held-out healthy run, and put all runs with a built-in fault into its group."""
    healthy = list(_runs("normal"))
    for k, one in enumerate(healthy):
        assert compare(one, healthy[:k] + healthy[k + 1 :])[0].group == NONE
    truth = {"backlash1": PLAY, "lackLubrication1": MORE, "spalling1": LOCAL}
    for name, group in truth.items():
        assert [compare(run, healthy)[0].group for run in _runs(name)] == [group] * 10


def _runs(name):
    """Each run of a recording: five strokes."""
    table = pd.read_csv(SCREW / f"{name}.csv")
    for _, run in table.groupby("run"):
        samples = pd.DataFrame(
            {
                "episode": run["stroke"] - run["stroke"].min(),
                "t_s": run["time"],
                "command_m.screw": 1e-3 * run["set_point"],
                "position_m.screw": 1e-3 * (run["set_point"] - run["position_error"]),
                "torque_n.screw": run["current"],
            }
        )
        yield make_log(LogMeta(schema=1, source=name), samples.reset_index(drop=True))


def test_what_cannot_be_compared_is_refused(screws):
    """Ask for enough healthy logs, of the same joints, motion and channels."""
    with pytest.raises(LogError, match="4 healthy logs or more"):
        compare(screws[0], screws[1:4])
    with pytest.raises(LogError, match="same mechanism"):
        compare(log_of(Real()), screws)
    other = screw(7)
    moved = other.samples.assign(**{"command_m.screw": other.samples["command_m.screw"] * 0.9})
    with pytest.raises(LogError, match="same commands"):
        compare(make_log(other.meta, moved), screws)
    bare = other.samples.drop(columns="torque_n.screw")
    with pytest.raises(LogError, match="torque of screw"):
        compare(make_log(LogMeta(schema=1, source="a test"), bare), screws)


def test_a_log_without_a_model_is_diagnosed(screws, tmp_path, capfd):
    """Write the groups and a picture; without healthy logs, say what is missing."""
    for number, one in enumerate(screws):
        write_log(one, tmp_path / f"may{number}", "csv")
    write_log(screw(99, hunting_m=1e-4), tmp_path / "today", "csv")
    healthy = [w for n in range(HEALTHY) for w in ("--healthy", str(tmp_path / f"may{n}"))]
    words = ["diagnose", str(tmp_path / "today"), *healthy, "--out", str(tmp_path / "out")]
    code = cli.call([*words, "--fail-on", "cause", "--json"])
    said = json.loads(capfd.readouterr().out)
    assert code == 1, said
    assert said["verdict"] == [PLAY] and said["joints"] == ["screw"]
    assert (tmp_path / "out/differences.png").stat().st_size > 10_000
    tables = ["diagnose", str(tmp_path / "today/samples.csv")]
    tables += [f"{w}/samples.csv" if w != "--healthy" else w for w in healthy]
    assert cli.call([*tables, "--out", str(tmp_path / "tables"), "--json"]) == 0
    of_tables = json.loads(capfd.readouterr().out)
    assert of_tables["groups"] == json.loads(json.dumps(said["groups"]))
    kept = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert kept["sentence"] == said["sentence"]
    shutil.rmtree(tmp_path / "out")
    for word, said in (("diagnose", "4 healthy logs"), ("calibrate", "names no mechanism")):
        words = [word, str(tmp_path / "today"), "--out", str(tmp_path / "out"), "--json"]
        assert cli.call(words) == 2
        assert said in json.loads(capfd.readouterr().out)["error"]
