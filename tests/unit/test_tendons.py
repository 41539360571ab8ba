"""Actuators on tendons: those that move a joint, and what follows it, are its drives."""

import mujoco
import numpy as np
import pandas as pd
import pytest

from backends.mjcf import Plain, Play, file_drives, written
from diagnosis import diagnose
from diagnosis.logs.log import Log, LogError, LogMeta, make_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.plain import model_text, numbers_of, plain_apart

FINGER = (
    '<body name="{0}_" pos="0 {1} .3"><inertial mass=".2" pos=".08 0 0" diaginertia="1e-4 5e-4 '
    '5e-4"/><joint name="{0}" axis="0 1 0" range="-60 60" armature=".004" damping=".02"/>'
    '<site name="s{0}" pos=".1 0 0"/></body>'
)
BOUND = (
    '<equality><joint joint1="right" joint2="left" polycoef="0 {0} 0 0 0" solref=".004 1"/>'
    "</equality>"
)
PULL = '<position name="grip" tendon="t" kp="80" kv="4" forcerange="-20 20" gear="{0}"/>'
TIME_S = np.arange(0.0, 8.0, 0.005)
COMMAND = 0.4 * np.repeat([0, 1, -1, 0.5, -0.3, 0.8, -0.6, 0.2], 200)


def hand(left: float = 0.5, right: float = 0.5, rate: float | None = 1.0, gear: float = 1.0) -> str:
    """Two fingers on a fixed tendon; the right one follows the left one, if it does."""
    joints = f'<joint joint="left" coef="{left}"/><joint joint="right" coef="{right}"/>'
    return (
        '<mujoco><option timestep=".001" integrator="implicitfast"/><worldbody>'
        f"{FINGER.format('left', 0.1)}{FINGER.format('right', -0.1)}</worldbody>"
        f'<tendon><fixed name="t">{joints}</fixed></tendon>'
        f"{'' if rate is None else BOUND.format(rate)}"
        f"<actuator>{PULL.format(gear)}</actuator></mujoco>"
    )


def log(xml: str, *names: str, position: np.ndarray | None = None) -> Log:
    """A log of fingers that step."""
    frame = {"t_s": TIME_S}
    for name in names:
        read = COMMAND if position is None else position
        frame |= {f"command_rad.{name}": COMMAND, f"position_rad.{name}": read}
    meta = {"schema": 1, "source": "test", "mechanism": {"mjcf": "hand.xml"}}
    return make_log(LogMeta.model_validate(meta), pd.DataFrame(frame), xml)


@pytest.mark.parametrize(
    ("more", "lever"),
    [({}, 1.0), ({"left": 1.0, "right": 2.0, "rate": -0.25}, 0.5), ({"gear": 3.0}, 3.0)],
)
def test_a_tendon_over_a_joint_and_its_follower_is_a_drive(more, lever):
    """Give the joint what the tendon does on it, by how far it moves with what follows."""
    found = file_drives(hand(**more))["left"]
    assert (found.kp, found.kd, found.limit) == pytest.approx(
        (80 * lever**2, 4 * lever**2, 20 * lever)
    )


@pytest.mark.parametrize("rate", [1.0, -0.5])
def test_a_hand_on_a_tendon_moves_as_in_mujoco(rate):
    """Replay a joint on a tendon as plain MuJoCo moves the file, and the text that is written."""
    xml = hand(left=1.0, right=0.5, rate=rate)
    one = log(xml, "left")
    world = mjcf_world(one)
    assert plain_apart(one, world) < 1e-3
    model, again = (mujoco.MjModel.from_xml_string(x) for x in (xml, model_text(one, world)))
    assert again.nu == 1 and again.actuator("grip").trntype[0] == mujoco.mjtTrn.mjTRN_JOINT
    ends = []
    for one in (model, again):
        data = mujoco.MjData(one)
        data.ctrl[:] = 0.3 * (1.0 + 0.5 * rate)
        mujoco.mj_step(one, data, 3000)
        ends.append(data.qpos.copy())
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)
    assert again.dof_armature == pytest.approx(model.dof_armature)


def test_other_joints_of_a_tendon_are_held():
    """Take a tendon whose other joints the log has not as the drive of the one that it has."""
    one = log(hand(left=2.0, rate=None), "left")
    assert mjcf_world(one).drives[0].kp_nm_rad == pytest.approx(80 * 2.0**2)
    assert plain_apart(one, mjcf_world(one)) < 1e-3


def test_a_weak_drive_on_a_tendon_is_named():
    """Name the gain of a hand whose real drive has another."""
    xml = hand()
    asked = Play(
        time_s=TIME_S, command=COMMAND[:, None], push=0 * COMMAND[:, None], start=np.zeros(1)
    )
    weak = written(xml, {"left": numbers_of(mjcf_world(log(xml, "left")))["left"]})
    moved = Plain(weak.replace('kp="80.0"', 'kp="45.0"'), ["left"], {}).positions(asked)[:, 0]
    moved = moved + 3e-4 * np.random.default_rng(0).normal(size=len(TIME_S))
    found = diagnose(log(xml, "left", position=moved))
    assert found.verdict == ("kp-scale",)
    assert found.magnitudes[0].value == pytest.approx(-44, abs=8)


def test_a_tendon_over_several_joints_of_the_log_is_refused():
    """Say which joints one tendon moves, and what to do."""
    xml = hand(rate=None)
    one = log(xml, "left", "right")
    with pytest.raises(LogError, match="'grip' moves joints 'left', 'right' at once, by a tendon"):
        mjcf_world(one)


def test_a_tendon_over_sites_is_refused():
    """Say that an actuator on a tendon over sites needs another in its place."""
    spatial = (
        '<tendon><spatial name="t"><site site="sleft"/><site site="sright"/></spatial></tendon>'
    )
    xml = hand(rate=None)
    xml = xml[: xml.index("<tendon>")] + spatial + xml[xml.index("</tendon>") + len("</tendon>") :]
    xml = xml.replace("<actuator>", '<actuator><position joint="left" kp="9" kv="1"/>')
    with pytest.raises(LogError, match="'grip' pulls a tendon over sites; allowed: fixed tendons"):
        mjcf_world(log(xml, "left"))
