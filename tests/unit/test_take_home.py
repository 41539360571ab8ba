"""What a diagnosis gives back runs in plain MuJoCo: play as a hinge, late signals in Python."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from backends.mjcf import JointNumbers, Plain, Play, file_drives, robot_file, written, written_urdf
from benchmark.cli import app as cli
from benchmark.gap.take_home import take_home
from diagnosis.evidence.evidence import evidence
from diagnosis.logs.two_files import Asked, pair
from diagnosis.motion.columns import with_numbers
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.plain_gap import plain_gap
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import model_text
from diagnosis.walk import diagnose

ARM = """<mujoco><option integrator="implicitfast"/><worldbody><body name="upper" pos="0 0 0.5">
<inertial mass="0.8" pos="0.15 0 0" diaginertia="8e-4 4e-3 4e-3"/>
<joint name="a" axis="0 1 0" range="-90 90" armature="0.02" damping="0.05"/></body></worldbody>
<actuator><position joint="a" kp="40" kv="1.2" forcerange="-8 8"/></actuator></mujoco>"""
NUMBERS = JointNumbers(
    kp=40, kd=1.2, limit=8, armature=0.02, damping=0.05, frictionloss=0, mass_kg=0.8
)
T = np.arange(0, 8, 0.005)


def shown(
    xml: str,
    command: np.ndarray,
    push: float = 0.0,
    step_s: float | None = 1e-3,
    drives: dict[str, dict[str, float]] | None = None,
    **beside: float,
) -> np.ndarray:
    """Positions (T,) of the arm in plain MuJoCo."""
    push_nm = np.full((len(T), 1), push)
    asked = Play(time_s=T, command=command[:, None], push=push_nm, start=np.zeros(1))
    world = Plain(xml, ["a"], {}, timestep_s=step_s, beside={"a": beside}, drives=drives or {})
    return world.positions(asked)[:, 0]


@pytest.mark.parametrize("angle", ["degree", "radian"])
def test_play_is_a_hinge_between_stops(angle):
    """Let a joint rest two halves of its play apart where the load is reversed."""
    text = ARM.replace("<option", f'<compiler angle="{angle}"/><option')
    text = text.replace('"-90 90"', '"-1.5 1.5"') if angle == "radian" else text
    loose = written(text, {"a": JointNumbers(**vars(NUMBERS) | {"play": 0.02})})
    still, weight = np.zeros(len(T)), 0.8 * 9.81 * 0.15
    ends = [shown(loose, still, push)[-1] for push in (0.0, 2 * -weight)]
    firm = [shown(text, still, push)[-1] for push in (0.0, 2 * -weight)]
    apart = np.diff(ends) - np.diff(firm)
    assert abs(apart[0]) == pytest.approx(0.04, rel=0.1)
    for none in (0.0, 1e-7):
        tight = JointNumbers(**vars(NUMBERS) | {"play": none})
        assert written(text, {"a": tight}).count("_play") == 0


def test_a_written_robot_stands_by_itself():
    """Run the file that is written: a command is late, slow, and read with scale and bias."""
    own = {"delay_s": 0.05, "scale": np.float64(0.1), "bias": 0.01}
    space = {}
    exec(robot_file({"a": own}, {}), space)
    robot = space["Robot"](mujoco.MjModel.from_xml_string(ARM))
    bare = space["Robot"](robot.model, {})
    steps = np.where(np.arange(400) > 100, 0.3, 0.0)
    read, plain = (np.array([one.step({"a": x})["a"] for x in steps]) for one in (robot, bare))
    late = round(0.05 / robot.model.opt.timestep)
    assert np.allclose(read[late + 90 :], 1.1 * plain[90:-late] + 0.01, atol=0.02)
    assert abs(read[105] - read[95]) < abs(plain[125] - plain[95])


COGGED = {
    "stiction_nm": 0.0,
    "load_friction": 0.0,
    "one_way_friction_nm": 0.0,
    "presliding_nm": 0.0,
    "thermal_fade": 0.0,
    "cogging_nm": 0.5,
    "torque_limit_nm": 8.0,
    "cogging_period_rad": 0.2,
    "cogging_phase_rad": 0.3,
    "thermal_s": 10.0,
    "presliding_rad": 3e-3,
    "stribeck_rad_s": 0.05,
    "creeps": 0.0,
}


@pytest.mark.parametrize("drives", [{}, {"a": COGGED}])
@pytest.mark.parametrize(
    "own",
    [
        {},
        {"delay_s": 0.0305, "slowness_s_rad": 2.0, "step": 0.05},
        {"late_s": 0.0123, "scale": 0.1, "sine": 0.03},
    ],
)
def test_a_written_robot_moves_as_the_gap_was_measured(own, drives):
    """Step the file that is written through a log, and read the same as its gap was taken from."""
    loose = written(ARM, {"a": JointNumbers(**vars(NUMBERS) | {"play": 0.02})})
    command = np.repeat(np.random.default_rng(0).uniform(-0.4, 0.4, 16), 100)
    space = {}
    exec(robot_file({"a": own}, drives), space)
    model = mujoco.MjModel.from_xml_string(loose)
    model.opt.timestep = 1e-3
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    robot = space["Robot"](model)
    read = [robot.step({"a": x})["a"] for x in np.repeat(command, 5)]
    found = shown(loose, command, drives=drives, **own)
    assert found == pytest.approx(np.array(read[::5]), abs=1e-9)


def diagnosed(folder: Path, real: str, file: str = ARM, **beside: Any) -> int:
    """Diagnose an arm's file by what a real one shows, into `folder`; the exit code."""
    rng = np.random.default_rng(1)
    command = np.repeat(rng.uniform(-0.4, 0.4, 16), 100)
    read = shown(real, command, **beside) + 3e-4 * rng.normal(size=len(T))
    return by_table(folder, file, {"a_cmd": command, "a_pos": read})


def by_table(folder: Path, arm: str, columns: dict[str, np.ndarray]) -> int:
    """Diagnose an arm by a table, into `folder`; the exit code."""
    pd.DataFrame({"time": T, **columns}).to_csv(folder / "r.csv")
    (folder / "arm.xml").write_text(arm)
    words = ["diagnose", "--robot", str(folder / "arm.xml"), "--log", str(folder / "r.csv")]
    return cli.call([*words, "--out", str(folder / "out"), "--json"])


def test_a_delay_is_taken_home(tmp_path, capfd):
    """Write what an MJCF cannot hold beside it, and measure the gap with both."""
    assert diagnosed(tmp_path, ARM, delay_s=0.03) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["command-delay"]
    model = found["model"]
    assert model["after_rad"] < 0.1 * model["before_rad"]
    (late,) = [one for one in model["changes"] if one["number"] == "delay_s"]
    assert late["after"] == pytest.approx(0.03, abs=0.003)
    assert "delay_s" in (tmp_path / "out" / "corrected.py").read_text()
    assert "this file has not: delay_s 0.0" in (tmp_path / "out" / "corrected.xml").read_text()


def test_a_term_of_drives_is_in_none_of_the_files():
    """Say that what no file said of the drives is not written, so that the gap shrinks less."""
    log = log_of(Real(joints=2, integral_hz=1.5, coulomb_nm={1: 3.0}))
    found = diagnose(log)
    model = take_home(log, mjcf_world(log), found, catalogue())
    assert model and model.beside == (found.limbs[0].law,)
    assert model.less == f"{found.limbs[0].law} is in none of the files"


@pytest.mark.parametrize(
    ("name", "real", "drives", "file", "text"),
    [
        ("gravity-compensation", '<body gravcomp="0.6" ', {}, "corrected.xml", "gravcomp"),
        ("joint-spring", '<joint stiffness="9" springref="40" ', {}, "corrected.xml", "springref"),
        ("cogging", "<body ", {"a": COGGED}, "corrected.py", "'cogging_nm': 0."),
    ],
)
def test_a_torque_is_taken_home(name, real, drives, file, text, tmp_path, capfd):
    """Write what carries a link, pulls it or cogs, and measure the gap with it."""
    tag = real.partition(" ")[0] + " "
    assert diagnosed(tmp_path, ARM.replace(tag, real, 1), step_s=None, drives=drives) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == [name] and not found["model"]["not_in_mjcf"]
    assert found["model"]["after_rad"] < 0.15 * found["model"]["before_rad"]
    assert text in (tmp_path / "out" / file).read_text()


def test_a_spring_of_the_file_may_be_gone(tmp_path, capfd):
    """Name a spring that a robot lacks, and take it out of the file."""
    sprung = ARM.replace("<joint ", '<joint stiffness="9" springref="40" ', 1)
    without = mujoco.MjModel.from_xml_string(written(sprung, {"a": NUMBERS}))
    assert without.jnt_stiffness[0] == 0.0
    assert diagnosed(tmp_path, ARM, file=sprung) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["joint-spring"]
    assert found["magnitudes"][0]["value"] == pytest.approx(-9.0, rel=0.05)
    assert found["model"]["after_rad"] < 0.15 * found["model"]["before_rad"]


def test_what_is_written_is_said(tmp_path, capfd):
    """Count the numbers that the file changes and the table of changes leaves out."""
    assert diagnosed(tmp_path, ARM.replace("damping", 'frictionloss="0.5" damping')) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"]
    texts = ARM, (tmp_path / "out" / "corrected.xml").read_text()
    before, after = map(mujoco.MjModel.from_xml_string, texts)
    kept = {
        "kp": np.array_equal(before.actuator_gainprm, after.actuator_gainprm),
        "kv": before.actuator_biasprm[0, 2] == after.actuator_biasprm[0, 2],
        "forcerange": np.array_equal(before.actuator_forcerange, after.actuator_forcerange),
        "armature": before.dof_armature[0] == after.dof_armature[0],
        "damping": before.dof_damping[0] == after.dof_damping[0],
        "frictionloss": before.dof_frictionloss[0] == after.dof_frictionloss[0],
        "mass": np.array_equal(before.body_mass, after.body_mass),
    }
    said = {one["number"] for one in found["model"]["changes"]}
    unsaid = {number for number, same in kept.items() if not same} - said
    assert "frictionloss" in said and 0 < len(unsaid) <= found["model"]["more"]


def test_a_urdf_stays_one():
    """Write masses, limits and friction into a URDF, and none into an MJCF."""
    text = """<robot name="u"><!-- mine --><link name="w"/><link name="l"><inertial>
    <mass value="1"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="a" type="revolute"><parent link="w"/><child link="l"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="20" velocity="3"/></joint></robot>"""
    again = written_urdf(text, {"a": JointNumbers(**vars(NUMBERS) | {"frictionloss": 0.3})})
    assert again is not None and "<!-- mine -->" in again
    drive = file_drives(again)["a"]
    assert (drive.limit, drive.damping) == (8, 0.05)
    assert 'value="0.8"' in again and 'friction="0.3"' in again
    assert written_urdf(ARM, {"a": NUMBERS}) is None
    held = written_urdf(text, {"a": JointNumbers(**vars(NUMBERS) | {"payload": 0.5})})
    assert mujoco.MjModel.from_xml_string(held).body_mass.sum() == pytest.approx(1.2)


def test_a_payload_is_weighed(tmp_path, capfd):
    """Tell a load at the end of a link from one at its centre, and write it there."""
    held = (
        '<body pos="0.3 0 0"><inertial mass="0.3" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/></body>'
    )
    assert diagnosed(tmp_path, ARM.replace("</body>", f"{held}</body>")) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["payload"]
    (mass, also) = found["magnitudes"][0]["also"].split(", ")
    assert mass.endswith("kg") and also.endswith("mm from its joint")
    model = found["model"]
    assert model["after_rad"] < 0.1 * model["before_rad"]
    (load,) = [one for one in model["changes"] if one["field"] == "body.payload"]
    assert load["after"] * 0.8 == pytest.approx(0.3, rel=0.2)
    assert "upper_payload" in (tmp_path / "out" / "corrected.xml").read_text()


def test_a_load_on_any_link_is_placed(tmp_path, capfd):
    """Find a load beside a link that carries another, and write it where it is."""
    more = """<body name="lower" pos="0.3 0 0" euler="0 0 90"><inertial mass="0.3" pos="0 -0.1 0"
    diaginertia="1e-3 2e-4 1e-3"/><joint name="b" axis="1 0 0" range="-90 90" armature="0.01"
    damping="0.03"/></body>"""
    servo = '<position joint="b" kp="15" kv="0.5" forcerange="-5 5"/>'
    arm = ARM.replace("</body>", f"{more}</body>").replace("</actuator>", f"{servo}</actuator>")
    held = '<body pos="0.12 0 0.1"><inertial mass="0.4" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/>'
    rng, real = np.random.default_rng(1), arm.replace(more, f"{more}{held}</body>")
    command = np.repeat(rng.uniform(-0.5, 0.5, (16, 2)), 100, axis=0)
    asked = Play(time_s=T, command=command, push=0.0 * command, start=np.zeros(2))
    read = Plain(real, ["a", "b"], {}, timestep_s=1e-3).positions(asked)
    read += 3e-4 * rng.normal(size=read.shape)
    both = {"cmd": command, "pos": read}
    table = {f"{j}_{what}": x[:, n] for what, x in both.items() for n, j in enumerate("ab")}
    assert by_table(tmp_path, arm, table) == 0
    found = json.loads(capfd.readouterr().out)
    assert (found["verdict"], found["joints"]) == (["payload"], ["a"])
    (load,) = found["magnitudes"]
    assert load["value"] == pytest.approx(50, rel=0.15) and load["low"] < 50 < load["high"]
    root = ElementTree.parse(tmp_path / "out" / "corrected.xml")
    (point,) = (body for body in root.iter("body") if body.get("name") == "upper_payload")
    assert np.array(point.get("pos").split(), dtype=float) == pytest.approx(
        [0.12, 0, 0.1], abs=0.02
    )


def test_friction_that_creeps_as_mujocos_is_taken_home(tmp_path, capfd):
    """Find the friction of another MuJoCo, which yields under load, and write such friction."""
    rubs = ARM.replace('damping="0.05"', 'damping="0.05" frictionloss="0.6"')
    assert diagnosed(tmp_path, rubs) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["coulomb-friction"]
    assert found["magnitudes"][0]["value"] == pytest.approx(600, rel=0.05)
    assert "solreffriction" not in (tmp_path / "out" / "corrected.xml").read_text()
    assert found["model"]["after_rad"] < 0.1 * found["model"]["before_rad"]


def test_friction_that_was_found_holds():
    """Let a joint stand under a load that its friction carries, in the file that is written."""
    rubs = written(ARM, {"a": JointNumbers(**vars(NUMBERS) | {"frictionloss": 0.8})})
    creeps = ARM.replace('damping="0.05"', 'damping="0.05" frictionloss="0.8"')
    still = np.zeros(len(T))
    push = 0.8 * 9.81 * 0.15 - 0.7  # less than the friction is left of the weight
    moved = [abs(np.ptp(shown(text, still, -push)[100:])) for text in (rubs, creeps)]
    assert moved[0] < 0.1 * moved[1]
    own = written(creeps, {"a": JointNumbers(**vars(NUMBERS) | {"frictionloss": 0.8})})
    assert "solreffriction" in rubs and "solreffriction" not in own


def test_a_tilt_is_taken_home(tmp_path, capfd):
    """Write the gravity that was found into the file's option, and measure the gap with it."""
    rng = np.random.default_rng(1)
    command = np.repeat(rng.uniform(-0.8, 0.8, 16), 100)
    real = ARM.replace("<option", f'<option gravity="{9.81 * np.sin(0.2)} 0 {-9.81 * np.cos(0.2)}"')
    read = shown(real, command, step_s=None) + 1e-4 * rng.normal(size=len(T))
    pd.DataFrame({"time": T, "a_cmd": command, "a_pos": read}).to_csv(tmp_path / "r.csv")
    (tmp_path / "arm.xml").write_text(ARM)
    words = ["diagnose", "--robot", str(tmp_path / "arm.xml"), "--log", str(tmp_path / "r.csv")]
    assert cli.call([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["verdict"] == ["gravity-tilt"] and found["model"]["not_in_mjcf"] == []
    assert found["model"]["gravity_m_s2"] == pytest.approx(
        [9.81 * np.sin(0.2), 0, -9.81 * np.cos(0.2)], abs=0.2
    )
    assert found["model"]["after_rad"] < 0.2 * found["model"]["before_rad"]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "corrected.xml"))
    assert model.opt.gravity == pytest.approx(found["model"]["gravity_m_s2"])


STIFF = ARM.replace('kp="40" kv="1.2"', 'kp="9000" kv="120"').replace("-8 8", "-800 800")


def test_a_time_step_is_taken_home_where_it_is_too_long(tmp_path):
    """Halve a time step whose error is larger than what the numbers change, and no other."""
    text = STIFF.replace("<option", '<option timestep="0.004"')
    time_s = np.arange(0, 4, 0.004)
    command = 0.4 * np.sin(2 * time_s) ** 3
    asked = Play(
        time_s=time_s, command=command[:, None], push=np.zeros((1000, 1)), start=np.zeros(1)
    )
    rubs = text.replace("damping=", 'frictionloss="5" solreffriction="1e-4 1" damping=')
    real = Plain(rubs, ["a"], {}, timestep_s=1e-4).positions(asked)[:, 0]
    pd.DataFrame({"time": time_s, "a_cmd": command, "a_pos": real}).to_csv(tmp_path / "r.csv")
    for xml, step_s in ((text, 4e-3), (text.replace('"0.004"', '"1e-4"'), 1e-4)):
        (tmp_path / "arm.xml").write_text(xml)
        log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked())
        nominal = mjcf_world(log)
        (part,) = limbs(nominal)
        limb = Limb(spec=part, recordings=recordings(log, part), rigid=True)
        better = with_numbers(nominal, {"a": {"drive.coulomb_nm": 5.0}})
        found = plain_gap(log, nominal, better, [evidence(limb)])
        assert found.file_step_s == step_s and found.after_rad < 0.2 * found.before_rad
        assert (found.step_s < step_s) == (step_s > 1e-4)
        again = mujoco.MjModel.from_xml_string(model_text(log, better, nominal, found.step_s))
        assert again.opt.timestep == found.step_s


def test_a_light_link_hangs_at_the_end_of_its_play():
    """Hold a link of 10 g at the stop of its play under a push, as one of 1 kg."""
    light = ARM.replace('gravcomp="0"', "").replace('mass="0.8"', 'mass="0.01"')
    light = light.replace("8e-4 4e-3 4e-3", "1e-6 1e-6 1e-6")
    numbers = JointNumbers(**vars(NUMBERS) | {"mass_kg": 0.01, "play": 0.02})
    weight = 0.01 * 9.81 * 0.15
    ends = [shown(written(light, {"a": numbers}), np.zeros(len(T)), p)[-1] for p in (1.0, -1.0)]
    assert ends[0] == pytest.approx(0.02 + (1.0 + weight) / 40, rel=0.02)
    assert ends[1] == pytest.approx(-0.02 - (1.0 - weight) / 40, rel=0.02)


def test_only_what_is_other_is_written(tmp_path):
    """Leave a joint whose numbers are the nominal ones as it is in the file."""
    two = ARM.replace(
        "</body></worldbody>",
        """<body name="lower" pos="0.3 0 0">
    <inertial mass="0.3" pos="0.1 0 0" diaginertia="1e-4 1e-3 1e-3"/>
    <joint name="b" axis="0 1 0" armature="0.01"/></body></body></worldbody>""",
    )
    two = two.replace(
        "</actuator>",
        '<general joint="b" gainprm="30" biasprm="0 -30 -1" biastype="affine"/></actuator>',
    )
    names = [f"{joint}_{kind}" for joint in "ab" for kind in ("cmd", "pos")]
    frame = pd.DataFrame({"time": T} | {name: 0.2 * np.sin(T) for name in names})
    frame.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "arm.xml").write_text(two)
    log = pair(tmp_path / "arm.xml", [tmp_path / "r.csv"], Asked())
    nominal = mjcf_world(log)
    assert "general" not in model_text(log, nominal)
    some = with_numbers(nominal, {"a": {"drive.coulomb_nm": 0.2}})
    text = model_text(log, some, nominal)
    assert '<general joint="b"' in text and 'frictionloss="0.2"' in text
