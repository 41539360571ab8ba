"""Torque and position of a joint: a locked gear's hysteresis curve, and slow motion's friction."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli

CYCLOID = Path(__file__).resolve().parents[3] / "shared/real_logs/cycloid"
ARM = """<mujoco><worldbody><body><inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/>
<joint name="a" axis="0 1 0" range="-90 90"/></body></worldbody></mujoco>"""
TIME = np.arange(0.0, 40.0, 0.01)


def answer(tmp_path, capfd, option, frame, *words) -> tuple[dict, str]:
    """The terms that show, by name, and the lines."""
    frame.to_csv(tmp_path / "table.csv", index=False)
    assert cli.call(["diagnose", f"--{option}", str(tmp_path / "table.csv"), *words, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    return {t["term"]: t for t in found["terms"] if t["shows"]}, " | ".join(found["said"])


def to_and_fro(period_s: float) -> np.ndarray:
    """A triangle between -1 and 1 that begins at 0 (T,)."""
    return 2 / np.pi * np.arcsin(np.sin(2 * np.pi * TIME / period_s))


def presses(play_rad, stiffness, friction, reach=4.0) -> pd.DataFrame:
    """A motor with dry friction behind a gear with play, whose output is locked."""
    torque = np.where(TIME < 20, reach, 5 * reach) * to_and_fro(5.0)
    position, at = np.zeros(len(TIME)), 0.0
    for k, tau in enumerate(torque):
        # it slides to where what the gear holds is within the friction
        low, high = (_place(tau + side * friction, play_rad, stiffness) for side in (-1, 1))
        position[k] = at = min(max(at, low), high)
    noise = np.random.default_rng(0).normal(scale=[[1e-5, 0.02]], size=(len(TIME), 2))
    rows = {"time": TIME, "position_deg": np.degrees(position + noise[:, 0])}
    return pd.DataFrame(rows | {"torque": torque + noise[:, 1]})


def _place(torque, play_rad, stiffness) -> float:
    """Where a gear holds a torque."""
    return torque / stiffness + np.sign(torque) * play_rad / 2


@pytest.mark.parametrize("play_deg", [0.0, 1.0, 3.0])
def test_a_locked_gear_shows_its_lost_motion(tmp_path, capfd, play_deg):
    """Find play and wind-up at three quarters of the small sweep, friction and stiffness."""
    stiffness, friction = 400.0, 1.2
    frame = presses(np.radians(play_deg), stiffness, friction)
    terms, said = answer(tmp_path, capfd, "locked", frame)
    # on the way back friction holds what the end of the sweep, at 4 Nm, has pressed
    lost = np.radians(play_deg) + (3.0 + 4.0 - 2 * friction) / stiffness
    assert terms["lost motion"]["value"] == pytest.approx(lost, rel=0.05)
    assert terms["stiffness"]["value"] == pytest.approx(stiffness, rel=0.05)
    assert terms["friction"]["value"] == pytest.approx(friction, rel=0.1)
    assert "at 3 Nm to either side" in said


def test_friction_beyond_the_small_sweep_is_said(tmp_path, capfd):
    """Ask for more torque where friction holds what presses."""
    _, said = answer(tmp_path, capfd, "locked", presses(0.05, 400.0, 3.5))
    assert "press harder in the smallest sweep" in said


def test_a_table_that_presses_to_one_side_is_refused(tmp_path, capfd):
    """Say what is lacking, and what columns there are where the torque is."""
    frame = presses(0.02, 400.0, 1.0).assign(torque=lambda rows: rows["torque"].abs())
    frame.to_csv(tmp_path / "table.csv", index=False)
    assert cli.call(["diagnose", "--locked", str(tmp_path / "table.csv")]) == 2
    assert "press about as far to both sides" in capfd.readouterr().err
    frame.drop(columns="torque").to_csv(tmp_path / "table.csv", index=False)
    assert cli.call(["diagnose", "--locked", str(tmp_path / "table.csv")]) == 2
    assert "no column is the torque of joint" in capfd.readouterr().err
    words = ["--locked", str(tmp_path / "table.csv"), "--moved", str(tmp_path / "table.csv")]
    assert cli.call(["diagnose", *words]) == 2
    assert "give one of --locked, --moved" in capfd.readouterr().err


@pytest.mark.parametrize("reaction", [False, True])
def test_a_moved_joint_shows_its_friction(tmp_path, capfd, reaction):
    """Find both frictions, a constant torque and a load, also by the torque of the reaction."""
    position = np.where(TIME < 20, to_and_fro(10.0), to_and_fro(4.0))
    speed = np.gradient(position, TIME)
    weight = -0.8 * 9.81 * 0.15 * np.cos(position)
    torque = 0.1 + 0.4 * np.sign(speed) + 0.3 * speed + 1.25 * weight
    torque += np.random.default_rng(1).normal(scale=0.02, size=len(TIME))
    frame = pd.DataFrame({"time": TIME, "a_position_rad": position})
    (tmp_path / "arm.xml").write_text(ARM)
    side = -1 if reaction else 1
    words = ("--robot", str(tmp_path / "arm.xml"))
    terms, _ = answer(tmp_path, capfd, "moved", frame.assign(a_torque_nm=side * torque), *words)
    for term, value in {"coulomb": 0.4, "viscous": 0.3, "weight": 0.25, "offset": 0.1}.items():
        assert terms[term]["value"] == pytest.approx(value, abs=0.03)


def test_a_joint_that_never_moves_is_refused(tmp_path, capfd):
    """Say that there is nothing to regress on."""
    frame = pd.DataFrame({"time": TIME, "position_rad": 0.0, "torque": to_and_fro(10.0)})
    frame.to_csv(tmp_path / "table.csv", index=False)
    assert cli.call(["diagnose", "--moved", str(tmp_path / "table.csv")]) == 2
    assert "moves in 0 stretches of 0.2 s; needed: 3 or more" in capfd.readouterr().err


@pytest.mark.skipif(not CYCLOID.is_dir(), reason="recordings of real robots are not there")
@pytest.mark.parametrize(
    ("name", "least", "most"), [("base_runin1", 2.0, 3.2), ("conic_4pre1", 0.35, 0.6)]
)
def test_a_cycloidal_drive_shows_its_play(tmp_path, capfd, name, least, most):
    """Find about the play of a plain drive, 3.05 deg, and of a preloaded one, 0.43 deg."""
    frame = pd.read_csv(CYCLOID / f"{name}.csv")
    terms, _ = answer(tmp_path, capfd, "locked", frame, "--unit", "turn")
    assert least < np.degrees(terms["lost motion"]["value"]) < most
