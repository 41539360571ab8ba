"""A robot of MuJoCo's own making: no gear, its own friction, none of the drives of this project.

What a stranger would send: the replay's equations are not the ones that made the log.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from benchmark import cli

ARM = """
<mujoco model="arm">
  <worldbody>
    <body name="lower" pos="0 0 0.4">
      <inertial mass="0.4" pos="0.10 0 0" diaginertia="0.0002 0.0015 0.0015"/>
      <joint name="elbow" axis="0 1 0" armature="0.01"/>
    </body>
  </worldbody>
</mujoco>
"""
KP, KD, LIMIT = 30.0, 0.6, 6.0
LOG = f"""
schema: 1
source: an arm without a gear
mechanism: {{mjcf: arm.xml, joints: {{elbow: {{kp: {KP}, kd: {KD}, limit: {LIMIT}}}}}}}
episodes: [{{episode: 0, protocol: triangle}}, {{episode: 1, protocol: multisine}}]
"""
FRICTION_NM, NOISE_RAD = 0.4, 5e-4
TICK_S, DRIVE_TICKS, REST_TICKS = 2.5e-4, 4, 8000


def simulated(commands: pd.DataFrame) -> pd.DataFrame:
    """The log of a PD law at 1 kHz on the joint itself, from rest."""
    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.timestep = TICK_S
    model.dof_frictionloss[:] = FRICTION_NM
    model.dof_solref[:] = (0.001, 1.0)  # friction that holds: by default MuJoCo's creeps
    model.dof_solimp[:] = (0.999, 0.9999, 0.001, 0.5, 2.0)
    rng, parts = np.random.default_rng(0), []
    for _, part in commands.groupby("episode"):
        data = mujoco.MjData(model)
        asked = part["command_rad.elbow"].to_numpy()
        ticks = round(float(np.median(np.diff(part["t_s"]))) / TICK_S)
        read = np.empty(asked.shape)
        data.qpos[:] = asked[0]
        run(model, data, asked[0], REST_TICKS)
        for k in range(len(part)):
            read[k] = data.qpos[0] + NOISE_RAD * rng.standard_normal()
            run(model, data, asked[k], ticks)
        parts.append(part.assign(**{"position_rad.elbow": read}).drop(columns="protocol"))
    return pd.concat(parts)


def run(model: mujoco.MjModel, data: mujoco.MjData, asked: float, ticks: int) -> None:
    """Let the arm follow a constant target."""
    for tick in range(ticks):
        if tick % DRIVE_TICKS == 0:
            data.qfrc_applied[:] = np.clip(KP * (asked - data.qpos) - KD * data.qvel, -LIMIT, LIMIT)
        mujoco.mj_step(model, data)


def test_friction_of_an_arm_without_a_gear_is_found(tmp_path: Path, capfd) -> None:
    """Name friction and noise, though nothing of the replay made the log."""
    folder, commands = tmp_path / "arm", tmp_path / "commands.csv"
    folder.mkdir()
    asked = ["excite", "--joints", "elbow", "--range=-60:60deg"]
    assert cli._run([*asked, "--protocol", "triangle,multisine", "--out", str(commands)]) == 0
    (folder / "arm.xml").write_text(ARM)
    (folder / "log.yaml").write_text(LOG)
    simulated(pd.read_csv(commands)).to_csv(folder / "samples.csv", index=False)
    capfd.readouterr()
    words = ["diagnose", str(folder), "--out", str(tmp_path / "out"), "--workers", "1", "--json"]
    assert cli._run(words) == 0
    found = json.loads(capfd.readouterr().out)
    assert set(found["verdict"]) == {"coulomb-friction", "encoder-noise"}
    size = {one["effect"]: one["value"] for one in found["magnitudes"]}
    assert size["coulomb-friction"] == pytest.approx(1e3 * FRICTION_NM, rel=0.05)
    assert size["encoder-noise"] == pytest.approx(1e3 * NOISE_RAD, rel=0.05)
