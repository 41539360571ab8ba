"""Recordings whose rows are read after their command has acted are logs like others."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from arms import Real, log_of

from backends.mjcf import Plain, Play
from diagnosis.logs.log import Log, LogMeta, make_log
from diagnosis.replay.alignment import SAID, with_commands_first
from diagnosis.solver import solve


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
    assert solve(log).verdict == (verdict,)


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


def test_a_weak_drive_is_no_late_row():
    """Move no command that would then be delayed by most of the row again."""
    time_s = np.arange(0.0, 20.0, 0.005)
    levels = np.random.default_rng(0).uniform(-1.0, 1.0, 12)
    steps = np.where(time_s < 12.0, levels[np.minimum(time_s.astype(int), 11)], 0.0)
    waves = sum(a * np.sin(f * time_s) for a, f in ((0.6, 2.0), (0.25, 5.7), (0.1, 13.0)))
    command = np.where(
        time_s < 12.0, steps, waves * np.minimum(np.maximum(time_s - 12.0, 0.0), 1.0)
    )
    command = command[:, None] * np.array([0.12, 0.6])
    play = Play(time_s=time_s, command=command, push=0 * command, start=command[0])
    moved = Plain(PORTAL.format(19), ["x", "a"], {}).positions(play)
    moved = moved + np.random.default_rng(1).normal(size=moved.shape) * np.array([2e-5, 4e-4])
    values = {
        "t_s": time_s,
        "command_m.x": command[:, 0],
        "position_m.x": moved[:, 0],
        "command_rad.a": command[:, 1],
        "position_rad.a": moved[:, 1],
    }
    meta = {"schema": 1, "source": "test", "mechanism": {"mjcf": "portal.xml"}}
    log = make_log(LogMeta.model_validate(meta), pd.DataFrame(values), PORTAL.format(30))
    assert with_commands_first(log) is log
