"""Robots in small: what public models have, in files of our own, each read and replayed.

None of these is refused, and each replay agrees with plain MuJoCo's.
"""

import numpy as np
import pandas as pd
import pytest

from backends.mjcf import file_drives, whole
from diagnosis.logs.log import LogMeta, make_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.plain import model_text, plain_apart

APART_RAD = 3e-3
"""Two seconds of sines, of coupled joints: what the expansion about the motion allows."""
I_ = '<inertial mass="0.6" pos="0.1 0.01 0" fullinertia="1e-3 3e-3 3e-3 1e-4 0 5e-5"/>'
GEOMS = '<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/>'


def chain(*joints: str, inner: str = I_, end: str = "") -> str:
    """Bodies on each other, 0.2 m apart, one joint each."""
    text = end
    for number, joint in reversed(list(enumerate(joints))):
        text = f'<body name="l{number}" pos="0.2 0 0.05">{joint}{inner}{text}</body>'
    return text


def hinge(name: str, axis: str = "0 1 0", more: str = 'armature="0.02" damping="0.1"') -> str:
    return f'<joint name="{name}" axis="{axis}" range="-2 2" {more}/>'


def mjcf(bodies: str, actuators: str = "", before: str = "", after: str = "") -> str:
    return (
        f'<mujoco model="small"><compiler angle="radian"/>{before}<worldbody>{bodies}</worldbody>'
        f"<actuator>{actuators}</actuator>{after}</mujoco>"
    )


def servo(*names: str, more: str = 'kp="60" kv="2" forcerange="-20 20"') -> str:
    return "".join(f'<position joint="{name}" {more}/>' for name in names)


TWO = chain(hinge("a", "0 0 1"), hinge("b"))
GENERAL = 'gainprm="100" biasprm="0 -100 -5" biastype="affine" forcerange="-50 50"'
DEFAULTS = """<default><joint damping="0.2" armature="0.03"/><default class="big">
<joint range="-3 3"/>
<position kp="80" kv="3" forcerange="-30 30"/><default class="small"><position kp="40"/></default>
</default></default>"""
TREE = '<body name="base" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .05" mass="5"/>'
URDF = """<robot name="u"><link name="world"/>{links}{joints}<transmission name="t"/>
<gazebo reference="l1"/></robot>"""
LINK = """<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="0.6"/>
<inertia ixx="1e-3" iyy="3e-3" izz="3e-3" ixy="1e-4" ixz="0" iyz="0"/></inertial><visual><geometry>
<mesh filename="package://u/{0}.dae"/></geometry></visual></link>"""
TURN = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 1 0"/>
<origin xyz="0.2 0 0.1"/><limit lower="-2" upper="2" effort="20" velocity="3"/>{4}</joint>"""


def urdf(second: str, more: str = "") -> str:
    """Two links by URDF joints, the second of a kind."""
    links = LINK.format("l1") + LINK.format("l2")
    joints = TURN.format("a", "revolute", "world", "l1", "")
    return URDF.format(links=links, joints=joints + TURN.format("b", second, "l1", "l2", more))


GAINS = {"kp": 60, "kd": 2, "limit": 20, "armature": 0.02}
ROBOTS: dict[str, tuple[str, tuple[str, ...], dict]] = {
    "general actuators": (
        mjcf(TWO, "".join(f'<general joint="{j}" {GENERAL}/>' for j in "ab")),
        ("a", "b"),
        {},
    ),
    "nested defaults": (
        mjcf(
            chain('<joint name="a" class="big" axis="0 1 0"/>', '<joint name="b" class="small"/>'),
            '<position joint="a" class="big"/><position joint="b" class="small"/>',
            DEFAULTS,
        ),
        ("a", "b"),
        {},
    ),
    "dampratio and inheritrange": (
        mjcf(TWO, servo("a", "b", more='kp="50" dampratio="1" inheritrange="1"')),
        ("a", "b"),
        {},
    ),
    "motors, gains said beside": (
        mjcf(TWO, '<motor joint="a" ctrlrange="-20 20"/><motor joint="b" ctrlrange="-20 20"/>'),
        ("a", "b"),
        {"joints": {"a": GAINS, "b": GAINS}},
    ),
    "gears, and a damper beside the servo": (
        mjcf(TWO, servo("a", "b", more='kp="15" gear="2"') + '<velocity joint="a" kv="2"/>'),
        ("a", "b"),
        {},
    ),
    "floating base": (
        mjcf(TREE + TWO + "</body>", servo("a", "b")),
        ("a", "b"),
        {"fix_base": True},
    ),
    "unlogged gripper of two slides": (
        mjcf(
            chain(
                hinge("a"),
                end='<body pos=".2 0 0"><joint name="f1" type="slide" axis="0 1 0" range="0 .04"/>'
                f"{I_}</body><body pos='.2 0 0'><joint name='f2' type='slide' axis='0 -1 0'/>{I_}"
                "</body>",
            ),
            servo("a"),
            after='<equality><joint joint1="f2" joint2="f1"/></equality>',
        ),
        ("a",),
        {"hold": {"f1": 0.0, "f2": 0.0}},
    ),
    "gravity compensated bodies": (
        mjcf(TWO.replace("<body ", '<body gravcomp="1" '), servo("a", "b")),
        ("a", "b"),
        {},
    ),
    "geoms with densities": (
        mjcf(chain(hinge("a"), hinge("b"), inner=GEOMS), servo("a", "b")),
        ("a", "b"),
        {},
    ),
    "frames and a turned body": (
        mjcf(
            '<frame euler="0 0 0.5" pos="0 0 1"><body quat="0.9 0.1 0.4 0.1">'
            f"{hinge('a')}{I_}</body></frame>",
            servo("a"),
        ),
        ("a",),
        {},
    ),
    "two joints on a body": (
        mjcf(f"<body>{hinge('a', '1 0 0')}{hinge('b')}{I_}</body>", servo("a", "b")),
        ("a", "b"),
        {},
    ),
    "joint friction": (
        mjcf(chain(hinge("a", more='armature=".02" damping=".6" frictionloss=".05"')), servo("a")),
        ("a",),
        {},
    ),
    "textures, lights, cameras, floor, keyframe": (
        mjcf(
            '<light pos="0 0 3"/><camera name="c" pos="0 0 2"/><geom type="plane" size="1 1 .1" '
            'material="m"/>' + TWO,
            servo("a", "b"),
            '<asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/>'
            '<material name="m" texture="t"/><mesh name="seen" file="seen.stl"/></asset>',
            '<keyframe><key qpos="0 0"/></keyframe><sensor><jointpos joint="a"/></sensor>',
        ),
        ("a", "b"),
        {},
    ),
    "numbers for names": (mjcf(TWO.replace('"a"', '"1"'), servo("1", "b")), ("1", "b"), {}),
    "stiff servos of a big arm": (
        mjcf(
            chain(hinge("a", more='armature="0.1"'), hinge("b", more='armature="0.1"')),
            servo("a", "b", more='kp="2000" kv="200" forcerange="-330 330"'),
        ),
        ("a", "b"),
        {},
    ),
    "six joints": (
        mjcf(
            chain(*(hinge(n, x) for n, x in zip("abcdef", ("0 0 1", "0 1 0") * 3, strict=True))),
            servo(*"abcdef", more='kp="1200" kv="60"'),
        ),
        tuple("abcdef"),
        {},
    ),
    "contacts that are excluded, sites, tendons for show": (
        mjcf(
            TWO.replace("</body>", '<site name="s"/></body>', 1),
            servo("a", "b"),
            after='<contact><exclude body1="l0" body2="l1"/></contact>',
        ),
        ("a", "b"),
        {},
    ),
    "URDF": (urdf("revolute"), ("a", "b"), {"joints": {"a": GAINS, "b": GAINS}}),
    "URDF, continuous": (urdf("continuous"), ("a", "b"), {"joints": {"a": GAINS, "b": GAINS}}),
    "URDF, fixed tool": (urdf("fixed"), ("a",), {"joints": {"a": GAINS}}),
    "URDF, a joint that mimics, held": (
        urdf("revolute", '<mimic joint="a" multiplier="0.5"/>'),
        ("a",),
        {"joints": {"a": GAINS}, "hold": {"b": 0.0}},
    ),
}


def log_of(name: str):
    """A log of joints that follow sines."""
    xml, joints, more = ROBOTS[name]
    time_s = np.arange(0, 4, 0.005)
    samples = {"t_s": time_s}
    for k, joint in enumerate(joints):
        for kind, late_s in (("command", 0.0), ("position", 0.03)):
            samples[f"{kind}_rad.{joint}"] = 0.2 * (1 - np.cos((2 + 0.5 * k) * (time_s - late_s)))
    mechanism = {"mjcf": "robot.xml", **more}
    meta = LogMeta.model_validate({"schema": 1, "source": "test", "mechanism": mechanism})
    return make_log(meta, pd.DataFrame(samples), whole(xml))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_is_read_as_mujoco_reads_it(name):
    """Build each robot's nominal world, replay it as plain MuJoCo, and write it again."""
    log = log_of(name)
    world = mjcf_world(log)
    assert set(world.hand.joint_names) == set(ROBOTS[name][1])
    assert plain_apart(log, world) < APART_RAD
    again = file_drives(model_text(log, world))
    for drive, joint in zip(world.drives, world.hand.joint_names, strict=True):
        assert again[joint].kp == pytest.approx(drive.kp_nm_rad)
        assert again[joint].kd == pytest.approx(drive.kd_nms_rad)


def test_there_are_twenty():
    """Hold as many robots as the public models that they stand for."""
    assert len(ROBOTS) >= 20
