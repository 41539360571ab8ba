"""Recordings whose commands act before their rows are logs like others."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from arms import Real, log_of

from backends.mjcf import Plain, Play
from diagnosis.logs.log import Log, LogMeta, make_log
from diagnosis.motion.columns import DELAY
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.alignment import with_moments
from diagnosis.replay.nominal import mjcf_world
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
    """Take commands earlier, say so, and name what is wrong beside it."""
    late = read_late(log_of(Real(joints=2, kp=kp)))
    log = with_moments(late)
    assert "before their rows" in log.warnings[-1]
    assert diagnose(log).verdict == (verdict,)


@pytest.mark.parametrize(
    "real",
    [
        Real(),
        Real(kp={0: 0.5}),
        Real(kp={0: 2.0}),
        Real(coulomb_nm={0: 2.0}),
        Real(delay_s=0.02),
        Real(lost_share=0.2),
        Real(lost_share=0.3),
        Real(joints=2, lost_share=0.25, alone=True),
        Real(spring_nm_rad3=400.0),
    ],
)
def test_no_fault_moves_a_command(real):
    """Leave logs as they are whose commands act from their rows on."""
    log = log_of(real)
    assert with_moments(log) is log


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
    assert with_moments(log) is log


def test_an_inertia_that_no_file_has_moves_no_command():
    """Fit what a first look is far from, before commands are said to be a row late."""
    time_s = np.arange(0.0, 16.0, 0.01)
    pan, tilt = (
        np.clip(time_s - 0.5, 0.0, 1.0) * (a * np.sin(f * time_s) + 0.15 * np.sin(3.1 * f * time_s))
        for a, f in ((0.7, 2.9), (0.4, 1.7))
    )
    sent = {"command_rad.pan": pan, "command_rad.tilt": tilt}
    log = logged(CAMERA.format(0.002), CAMERA.format(0.0), time_s, sent)
    assert with_moments(log) is log


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
    assert with_moments(log) is log


def sent_between(kp: float, ticks_late: int = 0) -> Log:
    """Commands every 10 ms, of which every 20 ms a row has the last, the joints 3 ms after it."""
    time_s, rng = np.arange(0.0, 24.0, 0.001), np.random.default_rng(3)
    sent_s = np.arange(0.0, 24.0, 0.01)
    sent = []
    for size, fast in ((0.6, 5.3), (0.4, 7.1)):
        levels = rng.uniform(-size, size, 16)[(sent_s / rng.uniform(0.7, 0.8)).astype(int) % 16]
        since_s = np.maximum(sent_s - 12.0, 0.0)
        waves = size * np.minimum(since_s, 1.0) * (np.sin(fast * since_s) + np.sin(2.0 * since_s))
        sent.append(np.where(sent_s < 12.0, levels * (sent_s > 0.5), 0.5 * waves))
    held = np.stack(sent, axis=1)[(time_s / 0.01 + 1e-9).astype(int)]
    late = np.concatenate([np.repeat(held[:1], ticks_late, axis=0), held])[: len(held)]
    names = ("command_rad.pan", "command_rad.tilt")
    arm = CAMERA.format(0.004)
    log = logged(
        arm.replace('tilt" kp="6"', f'tilt" kp="{kp}"'),
        arm,
        time_s,
        dict(zip(names, late.T, strict=True)),
    )
    samples = log.samples.assign(**dict(zip(names, held.T, strict=True)))[3::20].reset_index(
        drop=True
    )
    return replace(log, samples=samples.assign(t_s=samples["t_s"] - 0.003))


def test_commands_that_are_sent_between_rows():
    """Find when they act, and name a weak drive and no other."""
    healthy, weak = (with_moments(sent_between(kp)) for kp in (6.0, 4.2))
    early_s = (weak.samples["t_s"] - weak.samples["sent_s"]).to_numpy()
    assert 0.005 < np.median(early_s) < 0.011 and 0.003 < np.ptp(early_s) < 0.016
    assert diagnose(healthy).verdict == ("none",)
    found = diagnose(weak)
    assert found.verdict == ("kp-scale",) and found.joints == ("tilt",)
    (cause,) = found.magnitudes
    assert cause.low < -30.0 < cause.high
    assert diagnose(sent_between(4.2)).verdict != ("kp-scale",)


def test_a_delay_between_rows_is_known_to_a_row():
    """Give an interval that holds the delay from when its command was sent."""
    found = diagnose(with_moments(sent_between(6.0, ticks_late=20)))
    assert found.verdict == ("command-delay",)
    (cause,) = found.magnitudes
    assert cause.low < 20.0 < cause.high < 40.0


def test_a_command_acts_when_it_is_sent():
    """Replay commands that are sent in the midst of ticks as the same commands with a delay."""
    log = sent_between(6.0)
    limb = Limb(spec=mjcf_world(log), recordings=recordings(log, mjcf_world(log)), rigid=True)
    late = limb.with_signals(sent_s=[r.time_s + 0.0064 for r in limb.recordings])
    numbers = limb.nominal.copy()
    numbers[:, DELAY] = 0.0064
    assert np.ptp(limb.simulate(numbers) - limb.simulate(limb.nominal), axis=None) > 0.01
    assert np.abs(np.nan_to_num(late.simulate(limb.nominal) - limb.simulate(numbers))).max() < 1e-9
