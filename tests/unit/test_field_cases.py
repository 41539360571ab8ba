"""Robots as people have them: read as MuJoCo reads them, and refused for what matters alone."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from diagnosis_logs import faults

from backends.mjcf import JointNumbers, MjcfError, Plain, Play, file_drives, whole, written
from benchmark.cli import app as cli
from diagnosis import diagnose
from diagnosis.logs._meta import parse_meta
from diagnosis.logs.log import Log, LogError, LogMeta, make_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.plain import plain_apart
from diagnosis.replay.robot import contradictions, uncertainties
from diagnosis.triage.triage import triage

INERTIAL = '<inertial mass="0.8" pos="0.15 0 0" fullinertia="8e-4 4e-3 4e-3 2e-4 0 1e-4"/>'
JOINT = '<joint name="shoulder" axis="0 1 0" range="-90 90" armature="0.02" damping="0.05"/>'
SERVO = '<position joint="shoulder" kp="40" kv="1.2" forcerange="-8 8"/>'
ARM = (
    f'<mujoco model="arm"><worldbody><body name="upper" pos="0 0 0.5">{INERTIAL}{JOINT}</body>'
    f"</worldbody><actuator>{SERVO}</actuator></mujoco>"
)
CORNERS = " ".join(f"{x} {y} {z}" for x in (0, 0.3) for y in (-0.02, 0.02) for z in (-0.02, 0.02))
MESH = f'<asset><mesh name="link" vertex="{CORNERS}"/></asset><worldbody>'
HEAVY = '<geom type="mesh" mesh="link" mass="0.8"/>'
URDF = """<robot name="arm"><link name="base"/><link name="upper"><inertial><origin xyz="0.15 0 0"/>
<mass value="0.8"/><inertia ixx="8e-4" iyy="4e-3" izz="4e-3" ixy="2e-4" ixz="0" iyz="1e-4"/>
</inertial><visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.5"/><limit lower="-1.57" upper="1.57" effort="8" velocity="5"/>
<dynamics damping="0.05"/></joint><gazebo><plugin name="p"/></gazebo></robot>"""


def log_of(xml: str, joints: dict | None = None, names: tuple[str, ...] = ("shoulder",), **more):
    """A log of joints that follow sines."""
    time_s = np.arange(800) / 200
    samples = pd.DataFrame({"t_s": time_s})
    for k, name in enumerate(names):
        samples[f"command_rad.{name}"] = 0.3 * np.sin((2 + k) * time_s)
        samples[f"position_rad.{name}"] = 0.3 * np.sin((2 + k) * (time_s - 0.03))
    mechanism_ = {"mjcf": "arm.xml", "joints": joints or {}, **more}
    meta = LogMeta.model_validate({"schema": 1, "source": "test", "mechanism": mechanism_})
    return make_log(meta, samples, xml)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "<worldbody>",
            '<asset><texture name="g" type="2d" builtin="checker" width="9" height="9"/><material '
            'name="g" texture="g"/></asset><worldbody><geom type="plane" size="1 1 1" '
            'material="g"/>',
        ),
        ("</mujoco>", '<keyframe><key qpos="0 0 0.5 1 0 0 0 0.3"/></keyframe></mujoco>'),
        ("</mujoco>", '<sensor><touch site="s"/></sensor></mujoco>'),
        ("<joint", '<geom type="mesh" mesh="seen"/><joint'),
    ],
)
def test_what_is_only_seen_refuses_no_robot(old, new):
    """Read the same mechanism with textures, keyframes, sensors and the meshes that are seen."""
    more = ARM.replace(old, new, 1)
    if "seen" in new:
        more = more.replace(
            "<worldbody>", '<asset><mesh name="seen" file="s.stl"/></asset><worldbody>'
        )
    assert more != ARM
    assert mjcf_world(log_of(whole(more))) == mjcf_world(log_of(ARM))


def test_the_mass_of_a_mesh_counts(tmp_path):
    """Take a mass from a mesh in the text or in the folder; else name the body and the mesh."""
    inline = ARM.replace("<worldbody>", MESH, 1).replace(INERTIAL, HEAVY)
    assert mjcf_world(log_of(inline)).hand.bodies[0].mass_kg == pytest.approx(0.8)
    lines = [f"v {' '.join(c)}" for c in np.array(CORNERS.split()).reshape(8, 3)]
    faces = "1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"
    lines += [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in map(str.split, faces)]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "link.obj").write_text("\n".join(lines))
    asset = '<compiler meshdir="parts"/><asset><mesh name="link" file="link.obj"/></asset>'
    file = inline.replace(MESH, f"{asset}<worldbody>")
    link = mjcf_world(log_of(whole(file, tmp_path))).hand.bodies[0]
    other = mjcf_world(log_of(inline)).hand.bodies[0]
    assert (*link.com_m, *link.inertia_kgm2) == pytest.approx((*other.com_m, *other.inertia_kgm2))
    for other, folder, said in (
        (
            file,
            tmp_path / "parts",
            "mass of body 'upper' is in mesh 'link', and link.obj is missing",
        ),
        (file, None, "no other file is read"),
        (file.replace('file="link', 'file="../../link'), tmp_path, "outside its folder"),
    ):
        with pytest.raises(MjcfError, match=said):
            whole(other, folder)


def test_files_are_included_from_the_folder(tmp_path):
    """Put an included file in its place; refuse one that is missing, outside, or taken twice."""
    body = f'<body name="upper" pos="0 0 0.5">{INERTIAL}{JOINT}</body>'
    (tmp_path / "body.xml").write_text(f"<mujocoinclude>{body}</mujocoinclude>")
    split = ARM.replace(body, '<include file="body.xml"/>')
    assert mjcf_world(log_of(whole(split, tmp_path))) == mjcf_world(log_of(ARM))
    for file, said in (
        ('"none.xml"', "which is missing"),
        ('"/etc/passwd"', "outside its folder"),
        ('"body.xml"/><include file="body.xml"', "twice"),
    ):
        with pytest.raises(MjcfError, match=said):
            whole(split.replace('"body.xml"', file), tmp_path)


@pytest.mark.parametrize(
    ("actuator", "kp", "kd", "limit"),
    [
        (SERVO, 40, 1.2, 8),
        ('<position joint="shoulder" kp="10" kv="0.3" gear="2" forcerange="-4 4"/>', 40, 1.2, 8),
        (
            '<general joint="shoulder" gainprm="40" biastype="affine" biasprm="0 -40 -1.2" '
            'forcerange="-8 8"/>',
            40,
            1.2,
            8,
        ),
        (
            '<position joint="shoulder" kp="40"/><velocity joint="shoulder" kv="1.2"/>',
            40,
            1.2,
            None,
        ),
        ('<motor joint="shoulder" gear="4" ctrlrange="-2 2"/>', None, 0, 8),
    ],
)
def test_drives_are_those_of_the_file(actuator, kp, kd, limit):
    """Read the gains and the limit that MuJoCo's actuators amount to at the joint."""
    drive = file_drives(ARM.replace(SERVO, actuator))["shoulder"]
    assert (drive.kp, drive.limit) == (kp, limit)
    assert drive.kd == pytest.approx(kd)


def test_file_and_log_yaml_that_differ_are_both_named():
    """Let log.yaml count, and say both numbers where they are a fifth apart."""
    log = log_of(ARM, {"shoulder": {"kp": 400, "kd": 1.3}})
    assert mjcf_world(log).drives[0].kp_nm_rad == 400
    assert list(contradictions(log)) == [
        "shoulder: kp is 40 in arm.xml and 400 in log.yaml; log.yaml counts"
    ]
    with pytest.raises(LogError, match="no position actuator for shoulder, and log.yaml has no kp"):
        mjcf_world(log_of(ARM.replace(SERVO, "")))


def test_a_urdf_is_read_and_its_armature_is_free():
    """Take links, limits and friction of a URDF; leave the motor's inertia, not in it, free."""
    log = log_of(URDF, {"shoulder": {"kp": 40, "kd": 1.2}})
    world = mjcf_world(log)
    assert world.drives[0].torque_limit_nm == 8 and world.drives[0].viscous_nms_rad == 0.05
    assert any("motors of shoulder is unknown" in text for text in contradictions(log))
    assert uncertainties(log) == {("shoulder", "drive.rotor_inertia_kgm2"): 1.5}
    known = log_of(URDF, {"shoulder": {"kp": 40, "kd": 1.2, "armature": 0.02}})
    link, other = (mjcf_world(one).hand.bodies[0] for one in (known, log_of(ARM)))
    assert (*link.com_m, *link.inertia_kgm2) == pytest.approx((*other.com_m, *other.inertia_kgm2))
    assert link.joint.drive == other.joint.drive
    assert not uncertainties(known)


def test_names_may_be_numbers():
    """Take joints called 1, 2, ... as YAML reads them without quotes."""
    data = {"mjcf": "arm.xml", "joints": {1: {"kp": 1}}}
    meta = parse_meta({"schema": 1, "source": "test", "mechanism": data})
    assert list(meta.mechanism.joints) == ["1"]


TIP = '<body name="tip" pos="0.3 0 0"><joint name="tip"/><geom size="0.02" mass="0.3"/></body>'


def coupled(tip: str = TIP, more: str = "") -> str:
    """The arm with a tip that follows the shoulder."""
    equality = f'<equality><joint joint1="tip" joint2="shoulder"/>{more}</equality><actuator>'
    return ARM.replace(f"{JOINT}</body>", f"{JOINT}{tip}</body>").replace("<actuator>", equality)


def test_a_follower_is_simulated_or_held_on_demand():
    """Replay a coupled joint as plain MuJoCo does; hold it where log.yaml says so."""
    log = log_of(coupled())
    assert plain_apart(log, mjcf_world(log)) < 1e-3
    held = log_of(coupled(), hold={"tip": 0})
    assert plain_apart(held, mjcf_world(held)) < 1e-3
    assert len(mjcf_world(log).drives) == len(mjcf_world(held).drives) == 1
    bodies = (mjcf_world(one).hand.bodies for one in (log, held))
    assert [[b.name for b in some if b.joint.follows] for some in bodies] == [["tip"], []]


@pytest.mark.parametrize(
    ("xml", "names", "said"),
    [
        (coupled(), ("shoulder", "tip"), "leave out the columns"),
        (
            coupled(more='<joint joint1="tip" joint2="shoulder" polycoef="0 2"/>'),
            ("shoulder",),
            "along one polynomial; to hold it instead, add `hold: {tip: 0}`",
        ),
    ],
)
def test_a_joint_that_cannot_follow_is_named(xml, names, said):
    """Say what binds which joints, and what to do."""
    drives = {name: {"kp": 10, "kd": 1, "limit": 5} for name in names}
    with pytest.raises(LogError, match=re.escape(said)):
        mjcf_world(log_of(xml, drives, names))


@pytest.mark.parametrize(
    "xml",
    [
        ARM,
        ARM.replace('kp="40" kv="1.2" forcerange="-8 8"', 'kp="2000" kv="100"'),
        ARM.replace('armature="0.02"', 'armature="1e-4"'),
    ],
)
def test_the_nominal_world_is_plain_mujoco(xml):
    """Replay a nominal arm, damped, stiff or light, within 1e-6 rad of MuJoCo's own simulation."""
    log = log_of(xml)
    assert plain_apart(log, mjcf_world(log)) < 1e-6


STEPS = np.array([0.0, 0.4, -0.3, 0.2, -0.4, 0.1, 0.3, -0.1])


def moved(
    xml: str = ARM,
    factor: float = 1.0,
    zero: float = 0.0,
    off_s: tuple[float, float] = (0.0, 0.0),
    strokes: bool = False,
) -> Log:
    """The log of an arm in plain MuJoCo that steps; both sides scaled and shifted; off a while."""
    log, time_s = log_of(ARM), np.arange(1600) / 200
    command = np.repeat(STEPS, 200)[:, None]
    if strokes:  # there and back, and a rest
        command = 0.3 * np.sin(4 * np.minimum(time_s, np.pi * 1.5))[:, None]
    asked = Play(time_s=time_s, command=command, push=0 * command, start=np.array([0.0]))
    position = Plain(xml, ["shoulder"], {}, timestep_s=1e-3).positions(asked)[:, 0]
    position = position + 1e-4 * np.random.default_rng(0).normal(size=1600)
    position[(time_s >= off_s[0]) & (time_s < off_s[1])] = -1.5
    values = {"command_rad.shoulder": command[:, 0], "position_rad.shoulder": position}
    frame = pd.DataFrame({"t_s": time_s, **{name: factor * v + zero for name, v in values.items()}})
    return make_log(log.meta, frame, ARM)


@pytest.mark.parametrize(
    "xml",
    [
        ARM,
        ARM.replace("<joint", '<joint actuatorfrcrange="-3 3"'),
        ARM.replace("<joint", "<frame><joint").replace("/></body>", "/></frame></body>"),
        ARM.replace(SERVO, '<motor name="m" joint="shoulder" gear="5"/>'),
        ARM.replace(SERVO, SERVO.replace('kp="40"', 'gear="2" kp="40"') + SERVO),
        URDF,
    ],
)
def test_numbers_that_are_written_are_those_of_the_file(xml):
    """Write drive, friction and mass of a joint; MuJoCo reads the same numbers back."""
    numbers = {"kp": 30.0, "kd": 2.0, "limit": 9.0, "armature": 0.03, "damping": 0.2}
    text = written(xml, {"shoulder": JointNumbers(**numbers, frictionloss=0.4, mass_kg=0.9)})
    drive = file_drives(text)["shoulder"]
    found = (drive.kp, drive.kd, drive.limit, drive.armature, drive.damping)
    assert found == pytest.approx(tuple(numbers.values()))
    world = mjcf_world(log_of(text))
    assert world.hand.bodies[0].mass_kg == 0.9 and world.drives[0].coulomb_nm == 0.4


def test_the_corrected_model_is_a_file_that_moves_as_the_robot_does(tmp_path, capfd):
    """Write the user's own file with other numbers, and measure the gap with it in MuJoCo."""
    (tmp_path / "arm.xml").write_text(ARM.replace("<worldbody>", "<!-- mine --><worldbody>", 1))
    weak = ARM.replace('kp="40"', 'kp="24"').replace('kv="1.2"', 'kv="2"')
    moved(weak).samples.to_csv(tmp_path / "run.csv", index=False)
    words = ["diagnose", "--robot", str(tmp_path / "arm.xml"), "--log", str(tmp_path / "run.csv")]
    assert cli.call([*words, "--out", str(tmp_path / "out"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    model = found["model"]
    assert model["after_rad"] < 0.2 * model["before_rad"]
    (gain,) = [one for one in model["changes"] if one["number"] == "kp"]
    assert gain["before"] == 40 and abs(gain["after"] - 24) < 4
    text = (tmp_path / "out" / "corrected.xml").read_text()
    assert "<!-- mine -->" in text
    assert file_drives(text)["shoulder"].kp == gain["after"]


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (lambda: moved(factor=1 / (2 * np.pi)), "both are in turns"),
        (lambda: moved(factor=100 / 1.2), "both are in a unit of which about 8. make one rad"),
        (lambda: moved(factor=7.0), "both are in a unit of which about (7|6.9|7.1) make one rad"),
        (lambda: moved(zero=np.pi / 3), "both stand (57|60|63) deg from the model's zero"),
        (lambda: moved(ARM.replace('name="upper"', 'gravcomp="1" name="upper"')), "gravity_comp"),
    ],
)
def test_gravity_says_what_both_sides_are(log, said):
    """Name the unit of command and position together, or who carries the weight."""
    found = faults(log(), mjcf_world(log()))
    assert len(found) == 1
    assert re.search(said, str(found[0]))


@pytest.mark.parametrize(
    "xml",
    [
        ARM,
        ARM.replace('kp="40"', 'kp="60"'),
        ARM.replace('mass="0.8"', 'mass="0.6"'),
        ARM.replace("<joint", '<joint frictionloss="0.4"'),
    ],
)
def test_gravity_accuses_no_arm_that_differs_a_little(xml):
    """Leave gains, masses and friction to the diagnosis."""
    log = moved(xml)
    assert not triage(log, mjcf_world(log))


def test_a_drive_that_was_off_is_said_with_its_time():
    """Say from when to when a joint did not follow."""
    log = moved(off_s=(3.0, 4.5))
    said = triage(log, mjcf_world(log))
    assert said == ("shoulder did not follow from 3.0 to 4.5 s of episode 0",)


@pytest.mark.parametrize(("scatter_s", "step_rad"), [(0.0, 0.0), (0.0, 0.02), (0.008, 0.0)])
def test_stamps_that_are_too_regular_are_said(scatter_s, step_rad):
    """Say so where rows scatter in time and their stamps do not, not where readings are coarse."""
    fine = moved(strokes=True).samples
    rng, count = np.random.default_rng(3), 230
    real_s = np.sort(np.arange(count) / 30 + 0.02 + scatter_s * rng.normal(size=count))
    frame = pd.DataFrame({"t_s": np.arange(count) / 30})
    row = np.searchsorted(fine["t_s"], real_s, side="right") - 1
    frame["command_rad.shoulder"] = fine["command_rad.shoulder"].to_numpy()[row]
    frame["position_rad.shoulder"] = np.interp(real_s, fine["t_s"], fine["position_rad.shoulder"])
    if step_rad:
        read = frame["position_rad.shoulder"]
        frame["position_rad.shoulder"] = step_rad * np.round(read / step_rad)
    log = make_log(log_of(ARM).meta.model_copy(update={"channels": {}}), frame, ARM)
    said = " ".join(triage(log, mjcf_world(log)))
    assert ("made from a row number" in said) == bool(scatter_s)


def test_held_joints_stand_still_in_plain_mujoco():
    """Hold joints and a base in plain MuJoCo as the mechanism has them."""
    tip = (
        '<body pos="0.3 0 0"><joint name="tip" axis="0 1 0"/><geom size="0.02" mass="0.1"/></body>'
    )
    xml = ARM.replace(f"{JOINT}</body>", f"{JOINT}{tip}</body>").replace(
        '<body name="upper"', '<body><freejoint/><geom size="0.1"/><body name="upper"', 1
    )
    xml = xml.replace("</worldbody>", "</body></worldbody>")
    log = log_of(xml, hold={"tip": 0.5}, fix_base=True)
    assert plain_apart(log, mjcf_world(log)) < 1e-6
    model = Plain(xml, ["shoulder"], {"tip": 0.5})
    still = Play(
        time_s=np.arange(3.0), command=np.zeros((3, 1)), push=np.zeros((3, 1)), start=np.zeros(1)
    )
    assert model.positions(still)[-1, 0] == pytest.approx((0.8 * 0.15 + 0.1 * 0.3) * 9.81 / 40, 0.2)


def test_a_weak_drive_is_no_matter_of_nominal_numbers():
    """Name a gain that is five of its standard deviations low, which all others could hide."""
    found = diagnose(moved(ARM.replace('kp="40"', 'kp="30"')))
    assert found.verdict == ("kp-scale",) and found.magnitudes[0].value == pytest.approx(-25, abs=5)
