"""Recordings whose rows are read after their command has acted are logs like others."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from arms import Real, log_of

from backends.mjcf import Plain, Play
from diagnosis.logs.log import Log, LogMeta, make_log
from diagnosis.replay.alignment import SAID, with_commands_first
from diagnosis.walk import diagnose


def read_late(log: Log) -> Log:
    """The log as a program writes it that sends, waits and reads."""
    samples = log.samples.copy()
    sent = [name for name in samples.columns if name.startswith("command")]
    late = samples.groupby("episode")[sent].shift(1)
    samples[sent] = late.fillna(samples[sent])
    return replace(log, samples=samples)


@pytest.mark.parametrize(("kp", "verdict"), [({}, "none"), ({0: 0.6}, "kp-scale")])
def test_a_row_that_is_read_after_its_command_acted(kp, verdict):
    """Take commands a row earlier, say so, and name what is wrong beside it."""
    late = read_late(log_of(Real(joints=2, kp=kp)))
    log = with_commands_first(late)
    assert log.warnings[-1] == SAID
    assert diagnose(log).verdict == (verdict,)


@pytest.mark.parametrize(
    "real",
    [
        Real(),
        Real(kp={0: 0.5}),
        Real(kp={0: 2.0}),
        Real(coulomb_nm={0: 2.0}),
        Real(delay_s=0.02),
        Real(lost_share=0.3),
        Real(spring_nm_rad3=400.0),
    ],
)
def test_no_fault_moves_a_command(real):
    """Leave logs as they are whose commands act from their rows on."""
    log = log_of(real)
    assert with_commands_first(log) is log


PORTAL = """<mujoco><option timestep="0.001"/><worldbody><body><inertial mass="3" pos="0 0 0"
diaginertia=".01 .01 .01"/><joint name="x" type="slide" axis="1 0 0" range="-.3 .3" armature="2"
damping="8"/><body><inertial mass=".6" pos=".12 0 0" diaginertia="1e-3 3e-3 3e-3"/><joint name="a"
axis="0 1 0" range="-100 100" armature=".02" damping=".05"/></body></body></worldbody><actuator>
<position joint="x" kp="6000" kv="250" forcerange="-300 300"/><position joint="a" kp="{0}" kv="1"
forcerange="-6 6"/></actuator></mujoco>"""


NOISE = 2e-4
"""Of readings, over their travel."""
CAMERA = """<mujoco><option timestep="0.001"/><worldbody><body><inertial mass=".09" pos="0 0 .02"
diaginertia="4e-5 4e-5 3e-5"/><joint name="pan" axis="0 0 1" armature="{0}" damping=".005"/><body
pos="0 0 .04"><inertial mass=".14" pos=".03 0 .01" diaginertia="5e-5 9e-5 9e-5"/><joint name="tilt"
axis="0 1 0" armature="{0}" damping=".005" frictionloss=".01"/></body></body></worldbody><actuator>
<position joint="pan" kp="6" kv=".12"/><position joint="tilt" kp="6" kv=".12"/></actuator></mujoco>
"""


def logged(real: str, said: str, time_s: np.ndarray, command: dict[str, np.ndarray]) -> Log:
    """What a model does in plain MuJoCo, as the log of another; `command` by column."""
    sent = np.column_stack(list(command.values()))
    joints = [name.partition(".")[2] for name in command]
    play = Play(time_s=time_s, command=sent, push=0 * sent, start=sent[0])
    noise = np.random.default_rng(1).normal(size=sent.shape) * NOISE * np.ptp(sent, axis=0)
    moved = dict(zip(command, (Plain(real, joints, {}).positions(play) + noise).T, strict=True))
    read = {name.replace("command", "position"): column for name, column in moved.items()}
    meta = {"schema": 1, "source": "test", "mechanism": {"mjcf": "robot.xml"}}
    values = pd.DataFrame({"t_s": time_s, **command, **read})
    return make_log(LogMeta.model_validate(meta), values, said)


def test_a_weak_drive_is_no_late_row():
    """Move no command that would then be delayed by most of the row again."""
    time_s = np.arange(0.0, 20.0, 0.005)
    levels = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    steps = np.where(time_s < 12.0, levels[np.minimum(time_s.astype(int), 11)], 0.0)
    waves = sum(a * np.sin(f * time_s) for a, f in ((0.6, 2.0), (0.25, 5.7), (0.1, 13.0)))
    command = np.where(
        time_s < 12.0, steps, waves * np.minimum(np.maximum(time_s - 12.0, 0.0), 1.0)
    )
    sent = {"command_m.x": 0.12 * command, "command_rad.a": 0.6 * command}
    log = logged(PORTAL.format(19), PORTAL.format(30), time_s, sent)
    assert with_commands_first(log) is log


def test_an_inertia_that_no_file_has_moves_no_command():
    """Fit what a first look is far from, before commands are said to be a row late."""
    time_s = np.arange(0.0, 16.0, 0.01)
    pan, tilt = (
        np.clip(time_s - 0.5, 0.0, 1.0) * (a * np.sin(f * time_s) + 0.15 * np.sin(3.1 * f * time_s))
        for a, f in ((0.7, 2.9), (0.4, 1.7))
    )
    sent = {"command_rad.pan": pan, "command_rad.tilt": tilt}
    log = logged(CAMERA.format(0.002), CAMERA.format(0.0), time_s, sent)
    assert with_commands_first(log) is log


SCARA = """<mujoco><option timestep="{0}"/><worldbody><body pos="0 0 .3"><inertial mass="2.1"
pos=".1 0 0" diaginertia=".004 .012 .014"/><joint name="a" axis="0 0 1" damping=".4" armature=".08"
range="-130 130"/><body pos=".22 0 .02"><inertial mass="1.4" pos=".08 0 0" diaginertia=".002 .006
.007"/><joint name="b" axis="0 0 1" damping=".3" armature=".05" range="-140 140"/><body
pos=".18 0 0"><inertial mass=".6" pos="0 0 -.05" diaginertia=".001 .001 .0003"/><joint name="z"
type="slide" axis="0 0 1" damping="20" armature="1.5" range="-.15 .05"/></body></body></body>
</worldbody><actuator><position joint="a" kp="150" kv="6" forcerange="-25 25"/><position joint="b"
kp="{1}" kv="4" forcerange="-15 15"/><position joint="z" kp="9000" kv="260" forcerange="-150 150"/>
</actuator></mujoco>"""


def test_what_a_delay_undoes_is_no_late_row():
    """Leave commands that, a row earlier, other numbers would delay again."""
    time_s = np.arange(0.0, 16.0, 0.004)
    rng, smooth, sent = np.random.default_rng(7), np.ones(30) / 30, {}
    for name, low, high in (("rad.a", -0.5, 0.5), ("rad.b", -0.5, 0.5), ("m.z", -0.1, 0.0)):
        levels = rng.uniform(low, high, 16)[(time_s / rng.uniform(1.0, 2.0)).astype(int)]
        padded = np.append(np.full(29, levels[0]), levels)
        ramp = np.minimum(time_s, 1.0)
        sent[f"command_{name}"] = ramp * np.convolve(padded, smooth, "valid")
    log = logged(SCARA.format(0.0005, 63), SCARA.format(0.002, 90), time_s, sent)
    assert with_commands_first(log) is log
