"""Robots of MuJoCo's own making: no gears, their own friction, none of the drives of this project.

What a stranger would send: the replay's equations are not the ones that made the log.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli
from diagnosis.evidence.evidence import FLOOR_RAD
from diagnosis.motion.columns import with_numbers
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.plain import model_text, plain, plain_apart, shown
from tests.unit.arms import Real, log_of

ELBOW = """
<body name="lower" pos="{at} 0 0">
  <inertial mass="0.4" pos="0.10 0 0" diaginertia="0.0002 0.0015 0.0015"/>
  <joint name="elbow" axis="0 1 0" armature="0.01"/>
</body>
"""
SHOULDER = """
<body name="upper">
  <inertial mass="0.8" pos="0.12 0 0" diaginertia="0.0008 0.004 0.004"/>
  <joint name="shoulder" axis="0 1 0" armature="0.02"/>{}
</body>
"""
ARMS = {
    "elbow": ELBOW.format(at=0.0),
    "shoulder,elbow": SHOULDER.format(ELBOW.format(at=0.25)),
}
DRIVES = {"shoulder": (60.0, 1.5, 12.0), "elbow": (30.0, 0.6, 6.0)}
"""kp [Nm/rad], kd [Nms/rad], limit [Nm]."""
FRICTION_NM, NOISE_RAD = 0.4, 2e-3
TICK_S, DRIVE_TICKS, REST_TICKS = 2.5e-4, 4, 8000


def simulated(xml: str, joints: list[str], commands: pd.DataFrame) -> pd.DataFrame:
    """The log of PD laws at 1 kHz on the joints themselves, from rest; friction in the elbow."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.timestep = TICK_S
    model.dof_frictionloss[-1] = FRICTION_NM
    model.dof_solref[:] = (0.001, 1.0)  # friction that holds: by default MuJoCo's creeps
    model.dof_solimp[:] = (0.999, 0.9999, 0.001, 0.5, 2.0)
    rng, parts = np.random.default_rng(0), []
    for _, part in commands.groupby("episode"):
        data = mujoco.MjData(model)
        asked, push = (
            part[[f"{channel}.{name}" for name in joints]].to_numpy()
            for channel in ("command_rad", "push_nm")
        )
        ticks = round(float(np.median(np.diff(part["t_s"]))) / TICK_S)
        read = np.empty(asked.shape)
        data.qpos[:] = asked[0]
        run(model, data, joints, asked[0], 0.0, REST_TICKS)
        for k in range(len(part)):
            read[k] = data.qpos + NOISE_RAD * rng.standard_normal(len(joints))
            run(model, data, joints, asked[k], push[k], ticks)
        columns = {f"position_rad.{name}": read[:, j] for j, name in enumerate(joints)}
        parts.append(part.assign(**columns).drop(columns="protocol"))
    return pd.concat(parts)


def run(
    model: mujoco.MjModel, data: mujoco.MjData, joints: list[str], asked, push, ticks: int
) -> None:
    """Let the arm follow a constant target under a constant push."""
    kp, kd, limit = np.transpose([DRIVES[name] for name in joints])
    for tick in range(ticks):
        if tick % DRIVE_TICKS == 0:
            torque = np.clip(kp * (asked - data.qpos) - kd * data.qvel, -limit, limit)
        data.qfrc_applied[:] = torque + push
        mujoco.mj_step(model, data)


@pytest.mark.slow
@pytest.mark.parametrize("names", ["elbow", "shoulder,elbow"])
def test_friction_of_an_arm_without_gears_is_found(names: str, tmp_path: Path, capfd) -> None:
    """Name friction, where it is, and noise, though nothing of the replay made the log."""
    folder, commands, joints = tmp_path / "arm", tmp_path / "commands.csv", names.split(",")
    folder.mkdir()
    asked = ["excite", "--joints", names, "--range=-60:60deg", "--limit", "6Nm"]
    assert cli.call([*asked, "--out", str(commands)]) == 0
    xml = f"<mujoco><worldbody>{ARMS[names]}</worldbody></mujoco>"
    (folder / "arm.xml").write_text(xml)
    (folder / "log.yaml").write_text(log_text(joints))
    simulated(xml, joints, pd.read_csv(commands)).to_csv(folder / "samples.csv", index=False)
    capfd.readouterr()
    words = ["diagnose", str(folder), "--out", str(tmp_path / "out"), "--json"]
    assert cli.call(words) == 0
    found = json.loads(capfd.readouterr().out)
    assert set(found["verdict"]) == {"coulomb-friction", "encoder-noise"}
    size = {one["effect"]: one for one in found["magnitudes"]}
    assert size["coulomb-friction"]["joints"] == ["elbow"]
    assert size["coulomb-friction"]["value"] == pytest.approx(1e3 * FRICTION_NM, rel=0.05)
    assert size["encoder-noise"]["value"] == pytest.approx(1e3 * NOISE_RAD, rel=0.05)


def log_text(joints: list[str]) -> str:
    """The `log.yaml` of an arm."""
    numbers = (f"kp: {kp}, kd: {kd}, limit: {limit}" for kp, kd, limit in map(DRIVES.get, joints))
    drives = ", ".join(f"{name}: {{{n}}}" for name, n in zip(joints, numbers, strict=True))
    return f"""
schema: 1
source: an arm without gears
mechanism: {{mjcf: arm.xml, joints: {{{drives}}}}}
episodes:
  - {{episode: 0, protocol: steps}}
  - {{episode: 1, protocol: triangle}}
  - {{episode: 2, protocol: multisine}}
  - {{episode: 3, protocol: push}}
"""


@pytest.mark.parametrize(
    "numbers",
    [
        {"drive.cogging_nm": 1.0},
        {"drive.thermal_fade": 8.0},
        {"drive.presliding_nm": 0.3},
        {"drive.stiction_nm": 0.6},
        {"drive.load_friction": 0.3},
        {"drive.one_way_friction_nm": 0.8},
        {"drive.coulomb_nm": 0.8},
        {"drive.coulomb_nm": 0.8, "loop.soft_friction": 1.0},
        {"body.carried": 0.5},
        {"drive.spring_nm_rad": 20.0, "drive.spring_rest_rad": 0.4},
        {"drive.spring_nm_rad": 20.0, "drive.zero_rad": -0.3},
        {"drive.weakness": 0.5},
    ],
    ids=" ".join,
)
def test_what_is_written_moves_as_the_replay(numbers: dict[str, float]) -> None:
    """Move a written model, with what stands beside it, as the replay moves: within 3 %."""
    log = log_of(Real(joints=2))
    nominal = mjcf_world(log)
    world = with_numbers(nominal, dict.fromkeys(log.joints, numbers))
    names, every = log.joints, recordings(log, world)
    shown_rad = []
    for spec in (nominal, world):
        moved = plain(log, model_text(log, spec), names, world=spec)
        shown_rad.append([shown(moved, recording, spec) for recording in every])
    effect_rad = np.abs(np.subtract(*shown_rad)).max()
    assert effect_rad > 3e-3
    assert plain_apart(log, world) < 6e-5 + 0.03 * effect_rad


def test_known_play_is_no_difference_of_the_simulators() -> None:
    """Compare a robot with known play by what a replay can follow: not where it rattles."""
    log = log_of(Real(joints=2))
    play = dict.fromkeys(log.joints, {"drive.play_rad": 0.03})
    assert plain_apart(log, with_numbers(mjcf_world(log), play)) < FLOOR_RAD
