"""A user's MJCF as a spec: MuJoCo's own equations; what cannot be had is refused."""

import json
import pickle
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml
from joblib.externals.loky.backend.reduction import dumps

from backends import sticks, trx
from backends._mjcf_drives import DAMPING, PD_SHARE, PERIODS_S, RIGID_RAD, STIFF, STIFFNESS
from backends.catalogue import catalogue
from backends.drive import drive_table, motor_tick
from backends.mjcf import MjcfError, in_file, left_out, mechanism, written
from backends.spec import Spec
from backends.state import Array
from benchmark.cli import app as cli
from benchmark.parts import registry
from benchmark.settings.effects import effect_name, parse_effects
from diagnosis import diagnose
from diagnosis.logs.log import (
    DriveSettings,
    Log,
    LogError,
    LogMeta,
    MjcfMechanism,
    make_log,
    name_of,
    write_log,
)
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording
from diagnosis.replay.dynamics import dynamics, is_closed, springs
from diagnosis.replay.nominal import mjcf_world, own_catalogue
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import numbers_of


def servo(kp: float = 20.0, kd: float = 0.4, limit: float = 3.0, **more: str) -> DriveSettings:
    return DriveSettings(kp=kp, kd=kd, limit=limit, **more)


PENDULUM = """<mujoco model="pendulum"><worldbody><body name="arm" euler="20 30 40">
  <inertial mass="0.5" pos="0.02 0.01 -0.1" fullinertia="2e-3 3e-3 2e-3 2e-4 1e-4 -3e-4"/>
  <joint name="a" axis="1 2 0.5" pos="0.01 0.02 0.03" armature="0.01"/>
</body></worldbody></mujoco>"""
RAIL = """<mujoco model="rail"><worldbody><body name="cart" euler="0 25 0">
  <inertial mass="4" pos="0 0 0.1" diaginertia="0.1 0.1 0.1"/>
  <joint name="x" type="slide" axis="1 0 0.2" armature="2"/>
</body></worldbody></mujoco>"""
GANTRY = """<mujoco model="gantry"><worldbody><body name="bridge" euler="0 0 30">
  <inertial mass="4" pos="0 0 0" diaginertia="0.1 0.1 0.1"/>
  <joint name="x" type="slide" axis="1 0 0" armature="2"/>
  <body name="head" pos="0 0 0.2" euler="10 0 0"><inertial mass="1" pos="0 0 0"
    diaginertia="0.1 0.1 0.1"/><joint name="z" type="slide" axis="0.3 0 1" armature="1"/></body>
</body></worldbody></mujoco>"""
ARM = """<mujoco model="arm"><compiler angle="radian"/><option gravity="0.3 -1 -9.5"/><worldbody>
  <body name="base" pos="0 0 1" quat="0.9 0.1 0.3 -0.2"><geom type="sphere" size="0.1"/>
    <body name="turret" pos="0 0 0.1" euler="0.3 -0.5 0.7">
      <inertial mass="1.2" pos="0.03 0.02 0.1" fullinertia="6e-3 5e-3 4e-3 1e-3 -5e-4 7e-4"/>
      <joint name="yaw" axis="0 0.1 1" pos="0 0.02 0" armature="0.02" damping="0.05"/>
      <body name="upper" pos="0.1 0 0.2" euler="-0.4 0.2 1.1">
        <inertial mass="0.8" pos="0.1 -0.01 0.02" diaginertia="1e-3 4e-3 4e-3"
          quat="0.8 0.3 -0.4 0.1"/>
        <joint name="shoulder" axis="0.2 1 -0.3" armature="0.02" frictionloss="0.03" ref="0.4"/>
        <joint name="roll" axis="1 0 0" pos="0.05 0 0.01" armature="0.01"/>
        <body name="bracket" pos="0.2 0 0" euler="0.5 0.5 0">
          <inertial mass="0.1" pos="0.01 0 0" diaginertia="1e-4 1e-4 2e-4"/>
          <body name="lower" pos="0.02 0 0.01" euler="0 0.6 0">
            <inertial mass="0.4" pos="0.05 0 0" diaginertia="2e-4 5e-4 5e-4"/>
            <joint name="reach" type="slide" axis="1 0.2 0" armature="0.5"/>
          </body></body></body></body></body>
</worldbody></mujoco>"""
MECHANISMS = {
    "pendulum": (PENDULUM, {"a": servo()}),
    "rail": (RAIL, {"x": servo(kp=4000.0, kd=120.0, limit=200.0, sensor="motor")}),
    "gantry": (GANTRY, {"x": servo(4000.0, 120.0, 200.0), "z": servo(3000.0, 90.0, 100.0)}),
    "arm": (
        ARM,
        {
            "roll": servo(8.0, 0.1, 2.0),
            "yaw": servo(),
            "shoulder": servo(30.0, 0.6, 20.0),
            "reach": servo(900.0, 20.0, 30.0),
        },
    ),
}
"""A hinge, a slide, two slides, and a chain of hinges, a slide and a fixed link, all askew."""
SAMPLES, TICKS = 300, 5


def worlds() -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", MECHANISMS)


def commands(spec: Spec) -> Recording:
    """Targets that step and drift, and pushes, drawn at random for every joint."""
    rng, joints = np.random.default_rng(0), len(spec.hand.joint_names)
    steps = np.repeat(rng.uniform(-0.3, 0.3, (SAMPLES // 50, joints)), 50, axis=0)
    limit = np.array([d.torque_limit_nm for d in spec.drives])
    target = steps + 0.05 * np.cumsum(rng.normal(size=steps.shape), axis=0) / 20
    ticks = np.arange(SAMPLES) * TICKS
    one = recording(ticks * spec.timing.drive_s, target, 0.1 * limit * rng.normal(size=steps.shape))
    return replace(one, start=np.zeros(joints))


def recording(time_s: Array, target: Array, push: Array | None = None) -> Recording:
    """Targets and pushes (T, J), from rest at the first target."""
    return Recording(
        protocol="free",
        time_s=time_s,
        command=target,
        push=np.zeros_like(target) if push is None else push,
        measured=np.full((len(target), 3, target.shape[1]), np.nan),
        start=target[0],
    )


def replayed(spec: Spec, asked: Recording) -> Array:
    """What the sensors show by the replay in closed form (T, 3, J)."""
    limb = Limb(spec=spec, recordings=(asked,), rigid=False, exact=True)
    assert limb.closed
    return limb.simulate(limb.nominal, edges=limb.every_sample)


def bare(xml: str, dt_s: float) -> mujoco.MjModel:
    """The MJCF as MuJoCo simulates its links alone: motors and their friction are taken out."""
    model = mujoco.MjModel.from_xml_string(xml)
    model.dof_armature[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.opt.timestep = dt_s
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return model


def simulated(model: mujoco.MjModel, spec: Spec, asked: Recording) -> Array:
    """Joint and motor angles (2, T, J) by MuJoCo with the project's drive law, in spec order."""
    names, table = spec.hand.joint_names, drive_table(spec)
    data, at = mujoco.MjData(model), [model.joint(n).qposadr[0] for n in names]
    data.qpos[at] = asked.start
    motor, speed, out = asked.start.copy(), np.zeros(len(names)), []
    pd = np.zeros(len(names))
    for k in range(SAMPLES):
        out.append((data.qpos[at].copy(), motor.copy()))
        for _ in range(TICKS):
            for j in range(len(names)):
                motor[j], speed[j], pd[j], gear = motor_tick(
                    asked.command[k, j],
                    data.qpos[at[j]],
                    data.qvel[at[j]],
                    motor[j],
                    speed[j],
                    pd[j],
                    table[j],
                    model.opt.timestep,
                )
                data.qfrc_applied[at[j]] = gear + asked.push[k, j]
            mujoco.mj_step(model, data)
    return np.array(out).transpose(1, 0, 2)


@pytest.mark.parametrize("name", [n for n in MECHANISMS if n != "arm"])
def test_replay_is_mujocos_own_simulation(name):
    """Move like MuJoCo's links under the same drives, up to the rounding of 1500 steps."""
    spec = mechanism(*MECHANISMS[name])
    asked = commands(spec)
    expected = simulated(bare(MECHANISMS[name][0], spec.timing.drive_s), spec, asked)
    shown = replayed(spec, asked)[1:]
    motor = [body.joint.sensor == "motor" for body in spec.hand.driven]
    sensed = np.where(motor, expected[1], expected[0])
    assert np.ptp(expected[0], axis=0).min() > 0.05
    assert np.abs(shown[:, 0] - sensed[1:]).max() < 1e-9
    assert np.abs(shown[:, 1] - expected[1, 1:]).max() < 1e-9


@worlds()
def test_masses_and_torques_are_mujocos(name):
    """Give MuJoCo's mass matrix and bias torques at random states, up to rounding."""
    xml, servos = MECHANISMS[name]
    spec = mechanism(xml, servos)
    model = bare(xml, 1e-3)
    order = [model.joint(n).dofadr[0] for n in spec.hand.joint_names]
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    states = np.random.default_rng(1).uniform(-2, 2, (2, 20, model.nv))
    for q, v, mass, bias in zip(*states, *dynamics(spec, *states), strict=True):
        data.qpos[order], data.qvel[order] = q, v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        assert np.allclose(mass, full[np.ix_(order, order)], rtol=1e-12, atol=1e-13)
        assert np.allclose(bias, data.qfrc_bias[order], rtol=1e-11, atol=1e-12)


@worlds()
@pytest.mark.parametrize("aside", [0.0, 0.05])
def test_a_payload_is_a_point(name, aside):
    """Weigh and resist as MuJoCo does with a point mass that is written into the file."""
    xml, servos = MECHANISMS[name]
    spec, place = mechanism(xml, servos), {f"payload_{axis}_m": aside for axis in "xyz"}
    loaded = spec.with_driven(replace(body, payload=0.7, **place) for body in spec.hand.driven)
    numbers = numbers_of(loaded)
    for body in loaded.hand.driven if aside else ():
        at_m = in_file(xml, servos, {}, body.joint.name, body.payload_m)
        numbers[body.joint.name] = replace(numbers[body.joint.name], payload_m=at_m)
    model = bare(written(xml, numbers), 1e-3)
    assert model.body_mass.sum() > bare(xml, 1e-3).body_mass.sum()
    order = [model.joint(n).dofadr[0] for n in spec.hand.joint_names]
    data = mujoco.MjData(model)
    data.qpos[order] = q = np.random.default_rng(1).uniform(-1, 1, len(order))
    mujoco.mj_forward(model, data)
    _, bias = dynamics(loaded, q[None], np.zeros((1, len(q))))
    assert np.allclose(bias[0], data.qfrc_bias[order], rtol=1e-9, atol=1e-9)


COUPLED = """<mujoco><worldbody><body name="palm" pos="0 0 .4">
<body name="b" pos="-.1 0 0" gravcomp=".5"><inertial mass=".3" pos="-.1 0 0" diaginertia="1e-3 1e-3
1e-3"/><joint name="b" type="slide" axis="1 0 .5"/></body>
<body name="a" pos=".1 0 0"><inertial mass=".4" pos=".1 0 .02" diaginertia="1e-3 2e-3 2e-3"/>
<joint name="a" axis="0 1 0" ref="20" armature=".01"/><body name="tip" pos=".3 0 0">
<inertial mass=".2" pos=".05 .01 0" fullinertia="2e-3 2e-3 1e-3 1e-4 0 0"/>
<joint name="tip" axis="0 1 .2" armature="2e-3"/></body></body></body></worldbody>
<tendon><fixed name="t"><joint joint="a" coef="0.6"/><joint joint="b" coef="2"/></fixed></tendon>
<equality><joint joint1="tip" joint2="a" polycoef=".1 .9 .5 .2 0"/><tendon tendon1="t"/></equality>
</mujoco>"""


def test_springs_are_of_the_joint_that_leads():
    """Give the torque of MuJoCo's springs, of a joint's and of what follows it along a line."""
    xml = COUPLED.replace('ref="20"', 'ref="20" stiffness="3" springref="40"')
    xml = xml.replace('axis="1 0 .5"', 'axis="1 0 .5" stiffness="50" springref=".1"')
    spec = mechanism(xml, {"a": DriveSettings(kp=20, kd=1, limit=5)}, geared=False)
    model = mujoco.MjModel.from_xml_string(xml)
    data, at = mujoco.MjData(model), [model.joint(name).dofadr[0] for name in ("a", "tip", "b")]
    for q in (0.2, -0.7):
        x = q - ZERO
        data.qpos[at] = q, 0.1 + 0.9 * x + 0.5 * x**2 + 0.2 * x**3, -0.3 * x
        mujoco.mj_forward(model, data)
        assert -springs(spec, np.array([[q]])) == pytest.approx(RATE(x) @ data.qfrc_spring[at])
    curved = xml.replace('axis="0 1 .2"', 'axis="0 1 .2" stiffness="1"')
    with pytest.raises(MjcfError, match="'tip' has a spring that is not linear in the logged"):
        mechanism(curved, {"a": DriveSettings(kp=20, kd=1, limit=5)}, geared=False)


def test_what_follows_moves_as_in_mujoco():
    """Give the inertia and the torque of a joint with followers, on either side of it.

    One follows by a polynomial, one by a tendon with half of its weight carried: MuJoCo's own
    equations, projected onto where the followers are bound to be.
    """
    spec = mechanism(COUPLED, {"a": DriveSettings(kp=20, kd=1, limit=5)}, geared=False)
    (part,) = limbs(spec)
    model = mujoco.MjModel.from_xml_string(COUPLED)
    assert spec.drives[0].rotor_inertia_kgm2 == pytest.approx(0.01 + 2e-3 * RATE(-ZERO)[1] ** 2)
    data, full = mujoco.MjData(model), np.zeros((3, 3))
    at = [model.joint(name).dofadr[0] for name in ("a", "tip", "b")]
    for q, qd in ((0.2, 0.0), (0.4, 1.3), (-0.7, 2.0)):
        mass, bias = dynamics(part, np.array([[q]]), np.array([[qd]]))
        x = q - ZERO
        data.qpos[at] = q, 0.1 + 0.9 * x + 0.5 * x**2 + 0.2 * x**3, -0.3 * x
        data.qvel[at] = rate = RATE(x) * qd
        bend = np.array([0.0, 1.0 + 1.2 * x, 0.0]) * qd**2
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        links = (full - np.diag(model.dof_armature))[np.ix_(at, at)]
        assert mass[0, 0, 0] == pytest.approx(RATE(x) @ links @ RATE(x), rel=1e-9)
        forces = (data.qfrc_bias - data.qfrc_gravcomp)[at] + links @ bend
        assert bias[0, 0] == pytest.approx(RATE(x) @ forces, rel=1e-9)
        assert np.any(rate) == (qd != 0.0)


ZERO = np.radians(20)


def RATE(x):
    """How far the joint and its followers move per move of the joint, at x from its reference."""
    return np.array([1.0, 0.9 + x + 0.6 * x**2, -0.3])


@worlds()
def test_gears_are_rigid_and_stable(name):
    """Choose gears that hardly twist, with which a limb comes to rest."""
    spec = mechanism(*MECHANISMS[name])
    for drive in spec.drives:
        assert drive.gear_stiffness_nm_rad >= STIFF * drive.kp_nm_rad
        assert drive.gear_stiffness_nm_rad * RIGID_RAD >= drive.torque_limit_nm
    if not is_closed(spec):
        return
    time_s = np.array([0, 20000, 20001]) * spec.timing.drive_s
    asked = recording(time_s, np.full((3, len(spec.hand.joint_names)), 0.1))
    shown = replayed(spec, replace(asked, start=0.0 * asked.start))
    assert np.abs(shown[2, 0] - shown[1, 0]).max() < 1e-9 * spec.timing.drive_s


def test_gears_of_coupled_joints_stay_below_the_bound():
    """Keep the fastest mode of all gears and drives together below 4, where steps turn unstable."""
    spec = mechanism(*MECHANISMS["arm"])
    xml, dt_s = MECHANISMS["arm"][0], spec.timing.drive_s
    model = bare(xml, dt_s)
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    order = [model.joint(n).dofadr[0] for n in spec.hand.joint_names]
    k, c, a, kp, kd = (
        np.diag([getattr(d, number) for d in spec.drives])
        for number in (
            "gear_stiffness_nm_rad",
            "gear_damping_nms_rad",
            "rotor_inertia_kgm2",
            "kp_nm_rad",
            "kd_nms_rad",
        )
    )
    stiff = np.block([[k + kp, -k], [-k, k]]) * dt_s**2
    stiff += 2 * dt_s * np.block([[c + kd, -c], [-c, c]])
    worst = 0.0
    for pose in np.random.default_rng(3).uniform(-1, 1, (200, model.nv)) * [np.pi, np.pi, np.pi, 1]:
        data.qpos[order] = pose
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        inertia = np.block([[a, 0 * a], [0 * a, full[np.ix_(order, order)]]])
        worst = max(worst, float(np.abs(np.linalg.eigvals(np.linalg.solve(inertia, stiff))).max()))
    assert 1.0 < worst < 4.0
    assert STIFFNESS**2 + 4 * DAMPING * STIFFNESS + PD_SHARE < 4.0


def test_armature_and_friction_are_the_motors():
    """Read armature, damping and frictionloss as the motor's, in the order of the MJCF."""
    spec = mechanism(*MECHANISMS["arm"])
    assert spec.hand.joint_names == ("yaw", "shoulder", "roll", "reach")
    assert [d.rotor_inertia_kgm2 for d in spec.drives] == [0.02, 0.02, 0.01, 0.5]
    assert [d.viscous_nms_rad for d in spec.drives] == [0.05, 0.0, 0.0, 0.0]
    assert [d.coulomb_nm for d in spec.drives] == [0.0, 0.03, 0.0, 0.0]
    assert spec.drives[1].kp_nm_rad == 30.0 and spec.drives[1].torque_limit_nm == 20.0
    assert [b.joint.slides for b in spec.hand.driven] == [False, False, False, True]


def test_arms_on_one_base_are_limbs_of_their_own():
    """Split what a standing base carries: its arms move independently of each other."""
    arm = """<body name="{0}" pos="0 {1} 0"><inertial mass="1" pos="0.1 0 0"
      diaginertia="1e-3 1e-3 1e-3"/><joint name="{0}" axis="0 1 0" armature="0.01"/></body>"""
    xml = f"""<mujoco><worldbody><body name="base" pos="0 0 1"><inertial mass="9" pos="0 0 0"
      diaginertia="1 1 1"/>{arm.format("left", 1)}{arm.format("right", -1)}
      </body></worldbody></mujoco>"""
    spec = mechanism(xml, {"left": servo(), "right": servo()})
    assert [part.hand.joint_names for part in limbs(spec)] == [("left",), ("right",)]
    assert [body.origin_m for body in spec.hand.bodies] == [(0, 1, 1), (0, -1, 1)]


def test_weightless_worlds_weigh_nothing():
    """Honour the flag that switches gravity off."""
    flagged = PENDULUM.replace(
        "<worldbody>", '<option><flag gravity="disable"/></option><worldbody>', 1
    )
    assert mechanism(flagged, {"a": servo()}).gravity_m_s2 == (0.0, 0.0, 0.0)


def test_meshes_are_not_needed():
    """Take a body with a mesh from its inertial, without the mesh's file."""
    asset = '<asset><mesh name="m" file="arm.stl"/></asset><worldbody>'
    with_mesh = PENDULUM.replace("<worldbody>", asset, 1).replace(
        '<joint name="a"', '<geom type="mesh" mesh="m"/><joint name="a"'
    )
    servos = {"a": servo()}
    assert mechanism(with_mesh, servos).digest == mechanism(PENDULUM, servos).digest


FINGER = """<body name="c" pos="0 0 1"><inertial mass="1" pos="0 0.2 0" diaginertia="1 1 1"/>
  <joint name="z" axis="1 0 0"/></body>"""


def test_what_is_left_out_is_said():
    """Name end stops, contacts, and joints that are held."""
    more = PENDULUM.replace('armature="0.01"/>', 'armature="0.01" range="-30 30"/>').replace(
        "</body>", f'<geom size="0.1"/>{FINGER}</body><geom type="plane" size="1 1 1"/>'
    )
    assert left_out(PENDULUM, {"a": (-3.0, 3.0)}) == ()
    said = " ".join(left_out(more, {"a": (-0.4, np.deg2rad(29.9))}))
    assert "contacts of 2 geoms" in said and "which the log reaches: a" in said
    assert "which are held: z" in said
    assert "end stops" not in " ".join(left_out(more, {"a": (-0.4, 0.4)}))


def test_joints_without_a_drive_are_held():
    """Make one body of a link and what hangs on held joints, where these are held."""
    jointed = PENDULUM.replace("</body>", f"{FINGER}</body>")
    welded = jointed.replace('<joint name="z" axis="1 0 0"/>', "")
    turned = welded.replace('name="c" pos="0 0 1"', 'name="c" pos="0 0 1" euler="90 0 0"')
    for hold, other in (({}, welded), ({"z": np.pi / 2}, turned)):
        held = mechanism(jointed, {"a": servo()}, held=hold)
        assert numbers(held) == pytest.approx(numbers(mechanism(other, {"a": servo()})))


def numbers(spec: Spec) -> list[float]:
    """Mass matrix and bias torques of a world at a pose."""
    pose = np.ones((1, len(spec.hand.joint_names)))
    mass, bias = dynamics(spec, 0.3 * pose, pose)
    return [*mass.ravel(), *bias.ravel()]


def test_a_floating_base_stands_where_the_file_has_it():
    """Refuse it, or hold it where asked to; things that float beside the robot do not matter."""
    cube = '<body name="cube"><freejoint/><geom size="0.1"/></body></worldbody>'
    floating = PENDULUM.replace(
        "<worldbody>", '<worldbody><body euler="0 90 0"><freejoint/><geom size=".1"/>', 1
    ).replace("</worldbody>", f"</body>{cube}")
    fixed = PENDULUM.replace("<worldbody>", '<worldbody><body euler="0 90 0">', 1).replace(
        "</worldbody>", "</body></worldbody>"
    )
    with pytest.raises(MjcfError, match="floats; --fix-base"):
        mechanism(floating, {"a": servo()})
    held = mechanism(floating, {"a": servo()}, fix_base=True)
    assert numbers(held) == pytest.approx(numbers(mechanism(fixed, {"a": servo()})))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<joint", '<freejoint name="a"/><!-- <joint', "joint 'a' is of type free; allowed: slide"),
        ('axis="1 2 0.5"', 'type="ball"', "is of type ball"),
        ('name="a" axis', 'name="ab" axis', "has no joint 'a', it has: ab; did you mean 'ab'"),
        ('name="a" axis', "axis", "it has no joint 'a', it has: none"),
        ('armature="0.01"', 'armature="0.01" stiffness="3 1"', "has a spring that is not linear"),
        (
            "</worldbody>",
            "</worldbody><equality><joint joint1='a'/></equality>",
            "joint 'a' is bound to a constant by an equality",
        ),
        (
            "</worldbody>",
            "</worldbody><equality><connect body1='arm' anchor='1 0 0'/></equality>",
            "constraints between bodies that move",
        ),
        (
            "</worldbody>",
            "</worldbody><tendon><fixed stiffness='2'><joint joint='a' coef='1'/></fixed></tendon>",
            "tendons",
        ),
        ("<worldbody>", '<option density="1.2"/><worldbody>', "air or water"),
        ("<worldbody>", "<worldbod>", "it is no XML"),
        ('mass="0.5"', 'mass="-1"', "MuJoCo cannot compile"),
    ],
)
def test_what_cannot_be_honoured_is_refused(old, new, words):
    """Say which part of an MJCF cannot be had, and what to do."""
    xml = PENDULUM.replace(old, new, 1)
    if "<!--" in new:
        xml = xml.replace('armature="0.01"/>', 'armature="0.01"/> -->', 1)
    assert xml != PENDULUM
    with pytest.raises(MjcfError, match=words):
        mechanism(xml, {"a": servo()})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"kp": 1e9}, "kp of 'a' is 1e.09; allowed here: up to"),
        ({"kd": 1e5}, "kd of 'a' is 100000 on an armature of 0.01; allowed here: up to 48, or an"),
        ({"kp": None}, "has no kp"),
        ({"limit": None}, "has no limit"),
    ],
)
def test_impossible_drives_are_refused(changes, words):
    """Say what no drive period suits, and what would pass; refuse a drive without a number."""
    with pytest.raises(MjcfError, match=words):
        mechanism(PENDULUM, {"a": servo().model_copy(update=changes)})


def test_stiff_drives_get_a_shorter_period():
    """Halve the drive period until the gear is rigid and the law stable."""
    periods = [
        mechanism(PENDULUM, {"a": servo(kp=kp)}).timing.drive_s for kp in (20.0, 800.0, 5000.0)
    ]
    assert periods[0] == 1e-3 and periods[0] > periods[1] > periods[2]


def robot_log(xml: str, joints: dict[str, DriveSettings], linear: bool = False) -> Log:
    """A log of joints that step by 0.2 and answer with 0.15."""
    time_s = np.arange(200) * 5e-3
    samples = pd.DataFrame({"t_s": time_s})
    for name in joints:
        samples[name_of("command", name, linear)] = 0.2 * (time_s > 0.1)
        samples[name_of("position", name, linear)] = 0.15 * (time_s > 0.2)
    mechanism_ = MjcfMechanism(mjcf="robot.xml", joints=joints)
    meta = LogMeta(schema=1, source="test", mechanism=mechanism_)
    return make_log(meta, samples, xml)


def test_a_drive_without_a_limit_gets_one_that_never_matters():
    """Give it twice the torque that the largest error of the log asks for."""
    world = mjcf_world(robot_log(PENDULUM, {"a": DriveSettings(kp=20.0, kd=0.4)}))
    assert world.drives[0].torque_limit_nm == pytest.approx(2 * 20.0 * 0.2)


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (lambda: robot_log(PENDULUM, {"a": servo()}, linear=True), "'a' turns in the MJCF"),
        (lambda: robot_log(RAIL, MECHANISMS["rail"][1]), "'x' slides in the MJCF"),
        (lambda: robot_log(ARM, {"jaw": servo()}), "no joint jaw, .* did you mean 'yaw' for jaw"),
        (lambda: robot_log(ARM, {"yaw": DriveSettings()}), "no position actuator for yaw"),
        (lambda: robot_log("<mujoco", {"a": servo()}), "robot.xml: it is no XML"),
    ],
)
def test_logs_that_do_not_fit_their_mjcf_are_refused(log, words):
    """Name the file, the joint and the columns that do not go together."""
    with pytest.raises(LogError, match=words):
        mjcf_world(log())


def test_bounds_grow_with_the_mechanism_and_survive_other_processes():
    """Allow friction up to the drive's scale; leave shares alone, and a hand's effects as such."""
    names = "coulomb-friction", "direction-friction", "kp-scale"
    kinds = {n: registry.load("effect", n) for n in names}
    strong = robot_log(RAIL, MECHANISMS["rail"][1], linear=True)
    wide = own_catalogue(kinds, mjcf_world(strong))
    assert wide["kp-scale"] is kinds["kp-scale"]
    assert wide["coulomb-friction"].bounds == pytest.approx((0.0, 0.8 * 200.0))
    assert wide["direction-friction"].bounds == pytest.approx((-0.8 * 200.0, 0.8 * 200.0))
    effect = wide["coulomb-friction"](magnitude=50.0, joint="x")
    copy = pickle.loads(bytes(dumps(effect)))
    assert copy == effect and effect_name(copy) == "coulomb-friction"
    hand = trx.spec(sticks.STICKS["reference"])
    every = {n: registry.load("effect", n) for n in registry.names("effect")}
    found = own_catalogue(every, hand)
    assert {n for n in every if found[n] is not every[n]} == {"end-stop"}
    assert found["end-stop"].bounds == pytest.approx((-2.4, 2.4))


def test_the_page_on_own_robots_describes_one_that_works():
    """Make a mechanism of the MJCF and the drives that docs/guide/own-robot.md shows."""
    page = (Path(__file__).resolve().parents[2] / "docs/guide/own-robot.md").read_text()
    xml, settings = (
        re.search(rf"```{kind}\n(.*?)```", page, re.DOTALL).group(1) for kind in ("xml", "yaml")
    )
    joints = yaml.safe_load(settings)["mechanism"]["joints"]
    world = mechanism(xml, {name: DriveSettings(**drive) for name, drive in joints.items()})
    assert world.hand.joint_names == ("shoulder", "elbow")
    assert world.timing.drive_s == PERIODS_S[1]


def test_ordinary_noise_of_a_slide_is_no_finding():
    """Accuse no linear sensor of 0.13 % of its travel, and one of 1 %."""
    xml, joints = MECHANISMS["rail"]
    bare, time_s = robot_log(xml, joints, linear=True), np.arange(800) * 5e-3
    target = 0.1 * np.sin(3 * time_s) * np.sin(11 * time_s)
    moved = replayed(mjcf_world(bare), recording(time_s, target[:, None]))[:, 0, 0]
    for share, verdict in ((1.3e-3, "none"), (1e-2, "encoder-noise")):
        noise = share * np.ptp(moved) * np.random.default_rng(0).normal(size=800)
        samples = pd.DataFrame(
            {"t_s": time_s, "command_m.x": target, "position_m.x": moved + noise}
        )
        assert diagnose(make_log(bare.meta, samples, xml)).verdict == (verdict,)


def test_a_slide_is_diagnosed_by_the_command(tmp_path, capfd):
    """Name friction of a rail from its log, in newtons, in whatever is said and written."""
    xml, joints = MECHANISMS["rail"]
    bare = robot_log(xml, joints, linear=True)
    time_s = np.arange(800) * 5e-3
    rng = np.random.default_rng(0)
    samples = pd.DataFrame({"t_s": time_s})
    target = 0.1 * np.sin(3 * time_s) * np.sin(11 * time_s)
    world = registry.load("effect", "coulomb-friction")(magnitude=30.0).on_spec(mjcf_world(bare))
    shown = replayed(world, recording(time_s, target[:, None]))[:, 0, 0]
    shown += 1e-4 * rng.normal(size=800)
    samples["command_m.x"], samples["position_m.x"] = target, shown
    write_log(make_log(bare.meta, samples, xml), tmp_path / "rail")
    words = ["diagnose", str(tmp_path / "rail"), "--out", str(tmp_path / "out"), "--json"]
    assert cli.call(words) == 0
    found = json.loads(capfd.readouterr().out)
    (size,) = found["magnitudes"]
    assert (size["effect"], size["unit"]) == ("coulomb-friction", "N")
    assert size["value"] == pytest.approx(30, rel=0.1)
    (known,) = parse_effects(found["effects"], world.hand, own_catalogue(catalogue(), world))
    assert known.magnitude == pytest.approx(30, rel=0.1)
    report = (tmp_path / "out" / "report.html").read_text().rpartition("</script>")[0]
    written = [json.dumps(found), report.rpartition("plotly")[2]]
    assert not re.search(r"\d (mNms?|Nms?|mrad|gcm2|deg)\b", " ".join(written))
    assert found["nominal"]["replay_apart_rad"] < 1e-6
    before, after = found["engine_gaps_rad"]
    assert after < 0.2 * before
