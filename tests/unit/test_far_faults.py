"""Faults far from the nominal world, where a linear step from there misleads."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from benchmark.cli import app as cli

HZ = 100
T = np.arange(12 * HZ) / HZ
ARM = """<mujoco><option timestep="0.002"/><worldbody>
<body><joint name="a" axis="0 0 1" armature="0.3" damping="1"/>
<inertial mass="4" pos="0 0 0.1" diaginertia="0.05 0.05 0.05"/>
<body pos="0 0 0.3"><joint name="b" axis="0 1 0" armature="0.2" damping="1"/>
<inertial mass="3" pos="0 0 0.15" diaginertia="0.03 0.03 0.01"/></body></body></worldbody><actuator>
<position joint="a" kp="1200" kv="60" forcerange="-176 176"/>
<position joint="b" kp="1200" kv="60" forcerange="-176 176"/></actuator></mujoco>"""
CAMERA = """<mujoco><option timestep="0.001"/><worldbody>
<body><joint name="a" axis="0 0 1" armature="0.01" damping="0.05" frictionloss="0.05"/>
<geom type="box" size="0.05 0.04 0.06" mass="0.9"/>
<body pos="0 0 0.1"><joint name="b" axis="0 1 0" armature="0.006" damping="0.04"
frictionloss="0.03"/><geom type="box" size="0.07 0.03 0.03" pos="0.002 0 0.001" mass="0.65"/>
</body></body></worldbody><actuator><velocity joint="a" kv="0.8" forcerange="-3 3"/>
<velocity joint="b" kv="0.6" forcerange="-2 2"/></actuator></mujoco>"""
PALLETISER = """<robot name="p"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 0.3"/><mass value="9"/>
<inertia ixx="0.3" iyy="0.3" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.3 0 0"/><mass value="8"/>
<inertia ixx="0.02" iyy="0.25" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-1.2" upper="1.2" effort="350" velocity="3"/><dynamics damping="5" friction="4"/>
</joint><joint name="b" type="revolute"><parent link="upper"/><child link="lower"/>
<origin xyz="0 0 0.45"/><axis xyz="0 1 0"/><limit lower="-1.2" upper="1.2" effort="180"
velocity="3"/><dynamics damping="3" friction="3"/></joint></robot>"""


def moved(model: mujoco.MjModel, asked: np.ndarray, most: float = np.inf) -> np.ndarray:
    """Positions (T, 2) under controls (T, 2), the first of which moves by `most` a second."""
    data, shown, last = mujoco.MjData(model), [], asked[0]
    for wanted in asked:
        shown.append(data.qpos.copy())
        for _ in range(round(1 / HZ / model.opt.timestep)):
            step = np.array([most, np.inf]) * model.opt.timestep
            last = last + np.clip(wanted - last, -step, step)
            data.ctrl[:] = last
            mujoco.mj_step(model, data)
    return np.array(shown)


def verdict(folder: Path, nominal: str, table: dict[str, np.ndarray], *words: str) -> dict:
    """What is said of the one limb of a robot by its table."""
    noise = np.random.default_rng(0)
    rows = {n: x + 1e-4 * noise.normal(size=len(T)) * ("pos" in n) for n, x in table.items()}
    pd.DataFrame({"time": T, **rows}).to_csv(folder / "run.csv", index=False)
    robot = folder / ("arm.urdf" if nominal.startswith("<robot") else "arm.xml")
    robot.write_text(nominal)
    files = "--robot", str(robot), "--log", str(folder / "run.csv"), "--out", str(folder / "out")
    assert cli.call(["diagnose", *files, *words]) == 0
    (limb,) = json.loads((folder / "out" / "diagnosis.json").read_text())["limbs"]
    return limb


def named(limb: dict) -> tuple[str, str, float]:
    """Effect, joint and size of the one cause that a limb has."""
    (cause,) = limb["causes"]
    return cause["effect"], cause["joint"], cause["value"]


@pytest.mark.parametrize(("slow_hz", "quick_hz", "size"), [(0.2, 0.5, 0.5), (0.1, 0.3, 1.0)])
def test_a_limit_far_below_a_joints_speed(tmp_path, slow_hz, quick_hz, size):
    """Find a target that moves by half a radian a second, where its command hardly moves faster."""
    waves = np.sin(2 * np.pi * slow_hz * T) + 0.3 * np.sin(2 * np.pi * quick_hz * T)
    asked = np.stack([size * waves, 0.4 * np.sin(2 * np.pi * 0.21 * T)], axis=1)
    read = moved(mujoco.MjModel.from_xml_string(ARM), asked, most=0.5)
    table = {
        f"{j}_{n}": x[:, k] for n, x in (("cmd", asked), ("pos", read)) for k, j in enumerate("ab")
    }
    effect, joint, value = named(verdict(tmp_path, ARM, table))
    assert (effect, joint) == ("command-rate-limit", "a")
    assert value == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize(("rubs_nm", "share"), [(0.15, 1.0), (0.28, 0.5)])
def test_friction_under_a_drive_of_speeds(tmp_path, rubs_nm, share):
    """Find dry friction where a gain that is lower, and friction to one side, look alike.

    And where it holds a joint nearly all the time, as a limit of its torque would.
    """
    hz = ((0.2, 0.5), (0.9, 0.4)), ((0.25, 0.6), (0.7, 0.4))
    asked = np.stack([sum(a * np.sin(2 * np.pi * f * T) for f, a in own) for own in hz], axis=1)
    asked[:, 1] *= share
    real = CAMERA.replace('frictionloss="0.03"', f'frictionloss="{rubs_nm}"')
    read = moved(mujoco.MjModel.from_xml_string(real), asked)
    table = {f"{j}_vel_cmd": asked[:, k] for k, j in enumerate("ab")}
    table |= {f"{j}_pos": read[:, k] for k, j in enumerate("ab")}
    effect, joint, value = named(verdict(tmp_path, CAMERA, table))
    assert (effect, joint) == ("coulomb-friction", "b")
    assert value == pytest.approx(1e3 * (rubs_nm - 0.03), rel=0.1)


def test_friction_is_no_play_of_a_stiff_drive(tmp_path):
    """Find friction that moves a stiff joint by far more than play that any robot may have."""
    drives = {"a": (9000, 450, 350), "b": (5000, 180, 180)}
    spec = mujoco.MjSpec.from_string(PALLETISER)
    for joint, (kp, kd, limit) in drives.items():
        act = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        act.set_to_position(kp=kp, kv=kd)
        act.forcerange, act.forcelimited = (-limit, limit), True
    spec.joint("b").frictionloss = 38.0
    spec.joint("a").armature, spec.joint("b").armature = 2.0, 1.0
    asked = np.stack([0.4 * np.sin(2 * np.pi * f * T) ** 3 for f in (0.13, 0.19)], axis=1)
    read = moved(spec.compile(), asked)
    table = {
        f"{j}_{n}": x[:, k] for n, x in (("cmd", asked), ("pos", read)) for k, j in enumerate("ab")
    }
    words = (f"--drive={j}=kp:{kp},kd:{kd},limit:{limit}" for j, (kp, kd, limit) in drives.items())
    effect, joint, value = named(verdict(tmp_path, PALLETISER, table, *words))
    assert (effect, joint) == ("coulomb-friction", "b")
    assert value == pytest.approx(35.0, rel=0.2)
