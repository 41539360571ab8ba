"""A few rows at rest: gain, friction, play, zero and scale, and what they cannot tell."""

import json

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli

ARM = """<mujoco><worldbody><body><inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/>
<joint name="a" axis="0 1 0" range="-90 90" armature="0.02"/></body></worldbody>
<actuator><position joint="a" kp="40" kv="1.2"/></actuator></mujoco>"""
TARGET = np.radians([0, 20, 40, 60, 40, 20, 0, -20, -40, -20, 0, 20])
SIDE = np.array([0, 1, 1, 1, -1, -1, -1, -1, -1, 1, 1, 1.0])


def rows(kp=40.0, zero=0.0, scale=0.0, band=0.0, carried=False) -> np.ndarray:
    """Where the arm rests [rad], by fixed-point iteration of its balance."""
    q = TARGET.copy()
    for _ in range(50):
        weight = 0.0 if carried else -0.8 * 9.81 * 0.15 * np.cos(q)
        q = TARGET - weight / kp - band * SIDE
    noise = 2e-4 * np.random.default_rng(0).normal(size=len(q))
    return q * (1 + scale) + zero + noise


def answer(tmp_path, capfd, read, *words, robot=True, **more) -> dict:
    """The JSON of the command on a table in degrees."""
    frame = pd.DataFrame({"a_target_deg": np.degrees(TARGET), "a_reading_deg": np.degrees(read)})
    frame.assign(**more).to_csv(tmp_path / "rests.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    model = ["--robot", str(tmp_path / "arm.xml")] if robot else []
    said = ["diagnose", *model, "--static", str(tmp_path / "rests.csv"), *words, "--json"]
    assert cli.call(said) == 0
    found = json.loads(capfd.readouterr().out)
    shown = {one["term"]: one for one in found["terms"] if one["shows"]}
    return {"shown": shown, "said": " | ".join(found["said"])}


def test_nothing_wrong_sags_as_its_gain_says(tmp_path, capfd):
    """Find the gain of the model, and nothing else."""
    found = answer(tmp_path, capfd, rows())
    assert set(found["shown"]) == {"sag"}
    assert found["shown"]["sag"]["low"] < 1 / 40 < found["shown"]["sag"]["high"]
    assert "which is another" not in found["said"]


@pytest.mark.parametrize(
    ("real", "term", "value", "said"),
    [
        ({"kp": 25.0}, "sag", 1 / 25, "its drive says 40, which is another"),
        ({"zero": 0.02}, "zero", 0.02, "readings are off by 1.[12] deg"),
        ({"scale": 0.05}, "scale", 0.05, "readings are 5 %"),
        ({"band": 0.01}, "band", 0.01, "it rests 1.[12] deg .* apart, by the side that it comes"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, capfd, real, term, value, said):
    """Say each fault by itself, with its size within the interval."""
    found = answer(tmp_path, capfd, rows(**real))
    one = found["shown"][term]
    assert one["value"] == pytest.approx(value, rel=0.05)
    assert all(abs(x["value"]) < 3e-3 for k, x in found["shown"].items() if k not in ("sag", term))
    assert pd.Series([found["said"]]).str.contains(said).all()


def test_a_gain_stands_where_another_number_is_said(tmp_path, capfd):
    """Hold the sag against the file's gain where the user says something else of the drive."""
    found = answer(tmp_path, capfd, rows(kp=25.0), "--drive", "a=kd:1")
    assert "its drive says 40, which is another" in found["said"]


def test_weight_that_does_not_show_is_carried(tmp_path, capfd):
    """Say so where an arm does not sag, and where it sags though its weight is to be carried."""
    found = answer(tmp_path, capfd, rows(carried=True))
    assert not found["shown"] and "an integral, or carries the weight" in found["said"]
    found = answer(tmp_path, capfd, rows(), "--gravity-compensation")
    assert "gravity compensation is missing" in found["said"]


def test_what_a_table_cannot_tell_is_said(tmp_path, capfd):
    """Name what is lacking without a model, with one side alone, and with five rows."""
    found = answer(tmp_path, capfd, rows(), robot=False)
    assert "no load is known; give --robot" in found["said"]
    capfd.readouterr()
    frame = pd.DataFrame(
        {"target [deg]": [0, 10, 20, 30, 40], "reading [deg]": [1, 11, 21, 31, 41.1]}
    )
    frame.to_csv(tmp_path / "five.csv", index=False)
    assert cli.call(["diagnose", "--static", str(tmp_path / "five.csv"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert "all targets are reached from one side" in " ".join(found["said"])
    assert "readings are off by 1 deg" in " ".join(found["said"])
    frame[:2].to_csv(tmp_path / "two.csv", index=False)
    assert cli.call(["diagnose", "--static", str(tmp_path / "two.csv")]) == 2
    assert "2 rows at rest; needed: 3 or more" in capfd.readouterr().err


def test_play_shows_where_a_load_is_reversed(tmp_path, capfd):
    """Tell play by the side that known loads press on, and the gain by their size."""
    load = np.tile([-3.0, -1.5, 1.5, 3.0], 3)
    weight = -0.8 * 9.81 * 0.15 * np.cos(TARGET)
    torque = weight - load
    read = TARGET - torque / 40 - 0.01 * np.sign(torque)
    found = answer(tmp_path, capfd, read, **{"a_load_nm": load})
    assert found["shown"]["play"]["value"] == pytest.approx(0.01, rel=0.1)
    assert "by the side that the load presses on" in found["said"]


def test_degrees_under_a_header_of_radians_are_asked_for(tmp_path, capfd):
    """Ask for the unit where targets are far beyond the joint's range, and take what is said."""
    read = rows(kp=25.0)
    frame = pd.DataFrame({"a_target_rad": np.degrees(TARGET), "a_reading_rad": np.degrees(read)})
    frame.to_csv(tmp_path / "rests.csv", index=False)
    (tmp_path / "arm.xml").write_text(ARM)
    words = ["diagnose", "--robot", str(tmp_path / "arm.xml")]
    words += ["--static", str(tmp_path / "rests.csv"), "--json"]
    assert cli.call(words) == 2
    assert "reach 60 rad, the joint only 1.57 rad: in which unit" in capfd.readouterr().err
    assert cli.call([*words, "--unit", "deg"]) == 0
    assert "its drive says 40, which is another" in capfd.readouterr().out
