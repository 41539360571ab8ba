"""Command and position both in another unit, which only the model shows."""

import re

import numpy as np
import pandas as pd
import pytest
from diagnosis_logs import faults

from backends.mjcf import Plain, Play
from diagnosis.logs.log import Log, LogError, LogMeta, make_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import triage

DEGREES = 180 / np.pi
TIME_S = np.arange(0.0, 12.0, 0.005)


def arm(joints: int, axis: str = "0 1 0", kp: float = 60.0, limit: float = 12.0) -> str:
    """A chain of links whose joints have no range."""
    bodies = "".join(
        f'<body pos="{0.3 * (j > 0)} 0 0"><inertial mass="{0.8 - 0.2 * j}" pos=".15 0 0" '
        f'diaginertia="1e-3 5e-3 5e-3"/><joint name="j{j}" axis="{axis}" armature=".02"/>'
        for j in range(joints)
    )
    drives = "".join(
        f'<position joint="j{j}" kp="{kp / (j + 1)}" kv="{kp / 30 / (j + 1)}" '
        f'forcerange="{-limit} {limit}"/>'
        for j in range(joints)
    )
    return (
        f"<mujoco><worldbody>{bodies}{'</body>' * joints}</worldbody><actuator>{drives}</actuator>"
        "</mujoco>"
    )


def steps(size: float) -> np.ndarray:
    """A new target every second."""
    return (
        size
        * np.array([0, 1, -1, 0.5, -0.2, 0.8, -0.6, 0.3, -0.9, 0.1, 0.7, -0.4])[TIME_S.astype(int)]
    )


def sines(size: float) -> np.ndarray:
    """A motion without rests."""
    return size * (np.sin(2 * TIME_S) + 0.5 * np.sin(5.3 * TIME_S)) * np.minimum(TIME_S, 1.0)


def log(xml: str, asked: np.ndarray, unit: float, real: str | None = None, late: int = 0) -> Log:
    """The log of an arm in plain MuJoCo, of which a radian is so many of the log's unit."""
    names = [f"j{j}" for j in range(xml.count("<body"))]
    command = np.stack([np.roll(asked, 40 * j) for j in range(len(names))], axis=1)
    play = Play(time_s=TIME_S, command=command, push=0 * command, start=command[0])
    moved = Plain(real or xml, names, {}, timestep_s=1e-3).positions(play)
    moved = moved + 3e-4 * np.random.default_rng(0).normal(size=moved.shape)
    moved = np.concatenate([np.repeat(moved[:1], late, axis=0), moved[: len(moved) - late]])
    frame = {"t_s": TIME_S}
    for j, name in enumerate(names):
        frame |= {
            f"command_rad.{name}": unit * command[:, j],
            f"position_rad.{name}": unit * moved[:, j],
        }
    meta = {"schema": 1, "source": "test", "mechanism": {"mjcf": "arm.xml"}}
    return make_log(LogMeta.model_validate(meta), pd.DataFrame(frame), xml)


@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.parametrize("motion", [steps, sines])
@pytest.mark.parametrize("size", [0.05, 0.3])
def test_degrees_are_known_by_weight_and_motion(joints, motion, size):
    """Name degrees, with rests and without, where the angles are far and where they are not."""
    found = faults(one := log(arm(joints), motion(size), DEGREES), mjcf_world(one))
    assert found and {fault.kind for fault in found} == {"unit"}
    assert all("degrees" in str(fault) and "--unit deg" in fault.remedy for fault in found)


def test_a_scale_near_a_unit_is_not_that_unit():
    """Name no unit where another scale beside it fits far better, as of a gear."""
    found = faults(one := log(arm(2), sines(0.3), 7 / DEGREES), mjcf_world(one))
    assert found and all("geared, 1 to 8.2, or" in str(fault) for fault in found)


@pytest.mark.parametrize(("joints", "motion"), [(1, steps), (1, sines), (2, steps), (2, sines)])
def test_a_motor_side_is_said_with_its_ratio(joints, motion):
    """Say that both sides are a motor's, behind a gear of 7 to 1, with rests and without."""
    found = faults(one := log(arm(joints), motion(0.3), 7.0), mjcf_world(one))
    assert found and re.search("motor-side, (6.9|7|7.1) to 1", str(found[0]))


@pytest.mark.parametrize("motion", [steps, sines])
@pytest.mark.parametrize(
    "change", [("", ""), ('kp="30.0', 'kp="18.0'), ("j2", 'j2" frictionloss="1')]
)
def test_all_joints_are_in_one_unit(motion, change):
    """Name the ratio for all joints at once: one that is upright, weak or sticks has no own."""
    xml = arm(3, limit=40.0).replace('"j0" axis="0 1 0"', '"j0" axis="0 0 1"')
    one = log(xml, motion(0.3), 7.0, real=xml.replace(*change, 1))
    (found,) = faults(one, mjcf_world(one))
    assert found.joints == ("j0", "j1", "j2")
    assert re.search(r"motor-side, (6\.[5-9]|7(\.1)?) to 1", str(found))


@pytest.mark.parametrize("motion", [steps, sines])
def test_a_joint_in_another_unit_than_others_is_named_alone(motion):
    """Name the one joint whose both sides are in degrees where the others are in radians.

    By its range: it bears no weight, and a joint without ends may turn so far.
    """
    xml = arm(2, "0 0 1").replace('name="j1"', 'name="j1" range="-180 180"')
    one = log(xml, motion(0.3), 1.0)
    own = [name for name in one.samples if str(name).endswith(".j1")]
    one = make_log(one.meta, one.samples.assign(**(DEGREES * one.samples[own])), one.mjcf_xml)
    (found,) = faults(one, mjcf_world(one))
    assert found.joints == ("j1",) and "degrees" in str(found)


@pytest.mark.parametrize(("joints", "motion"), [(1, steps), (1, sines), (2, sines), (3, sines)])
def test_another_zero_of_both_sides_is_known_by_weight(joints, motion):
    """Say how far the zero of the first joint is off, with rests and without."""
    one = log(arm(joints), motion(0.3), 1.0)
    own = [name for name in one.samples if str(name).endswith(".j0")]
    turned = one.samples.assign(**{name: one.samples[name] + np.pi / 3 for name in own})
    one = make_log(one.meta, turned, one.mjcf_xml)
    found = faults(one, mjcf_world(one))
    assert found[0].joints == ("j0",) and {fault.kind for fault in found} == {"zero"}
    assert re.search("both stand (57|60|63) deg from", str(found[0]))


@pytest.mark.parametrize("joints", [1, 3])
@pytest.mark.parametrize("motion", [steps, sines])
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"real": ('mass="0.8"', 'mass="1.2"')},
        {"real": ('kp="60.0"', 'kp="40.0"')},
        {"real": ('armature=".02"', 'armature=".02" frictionloss="0.5" damping="0.5"')},
        {"real": ("<body ", '<body gravcomp="0.5" ')},
        {"real": ('forcerange="-12.0 12.0"', 'forcerange="-4 4"')},
        {"late": 6},
    ],
)
def test_radians_are_never_another_unit(joints, motion, change):
    """Leave masses, gains, friction, limits, delays and carried weights to the diagnosis."""
    xml = arm(joints)
    real = {"real": xml.replace(*change["real"])} if "real" in change else change
    one = log(xml, motion(0.3), 1.0, **real)
    assert not {fault.kind for fault in faults(one, mjcf_world(one))} & {"unit", "zero"}


@pytest.mark.parametrize("motion", [steps, sines])
@pytest.mark.parametrize(("joints", "size"), [(1, 0.1), (1, 0.9), (2, 0.4)])
def test_a_biased_sensor_is_in_no_other_unit(motion, joints, size):
    """Name no unit where the readings of a joint are off by 5 degrees."""
    one, name = log(arm(joints), motion(size), 1.0), f"position_rad.j{joints - 1}"
    off = one.samples.assign(**{name: one.samples[name] + 0.08})
    one = make_log(one.meta, off, one.mjcf_xml)
    assert faults(one, mjcf_world(one)) == ()


def test_a_joint_that_stands_is_in_no_other_unit():
    """Name no unit of a joint that only sinks to where its weight lets it rest."""
    one = log(arm(1), np.full(len(TIME_S), 0.3), 1.0)
    read = one.samples["position_rad.j0"] + 0.03
    one = make_log(one.meta, one.samples.assign(**{"position_rad.j0": read}), one.mjcf_xml)
    assert faults(one, mjcf_world(one)) == ()


def test_a_gain_that_is_off_hides_no_degrees():
    """Name degrees, and no unit of another size, of a drive that is weaker than its file says."""
    xml = arm(2)
    one = log(xml, steps(0.1), DEGREES, real=xml.replace('kp="60.0"', 'kp="36.0"'))
    assert all("both are in degrees" in str(fault) for fault in faults(one, mjcf_world(one)))


def test_what_a_limit_would_explain_too_is_a_remark():
    """Say that an upright joint may be in degrees, or its drive stronger than its limit."""
    one = log(arm(1, "0 0 1"), steps(0.05), DEGREES)
    said = " ".join(triage(one, mjcf_world(one)))
    assert "commands and positions of j0 may be in degrees" in said
    assert "or its limit of torque is another" in said


def test_a_log_that_no_replay_follows_is_refused():
    """Ask for units, masses and gains where the nominal world falls apart along the motion."""
    xml = arm(3, kp=3.0)
    one = log(xml, sines(0.1), 40.0, real=xml.replace("<body ", '<body gravcomp="1" '))
    with pytest.raises(LogError, match="cannot follow this log"):
        triage(one, mjcf_world(one))
