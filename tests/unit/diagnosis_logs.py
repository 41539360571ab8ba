"""Logs for the tests of the diagnosis: of the hand, and of a user's own arm."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from backends.shard import simulate
from backends.spec import Spec
from benchmark.cli import app as cli
from benchmark.parts import registry
from benchmark.settings.effects import parse_effects
from diagnosis.logs.log import DriveSettings, EpisodeMeta, Log, LogMeta, MjcfMechanism, make_log
from diagnosis.motion.batch import replay
from diagnosis.motion.recordings import recordings
from diagnosis.recording.excitation import FREE, Excitation, Joints
from diagnosis.replay.nominal import mjcf_world
from diagnosis.triage.triage import Fault, FaultError, triage

ENGINES = [
    pytest.param(name, marks=() if name == "bullet" else pytest.mark.slow)
    for name in registry.names("backend")
]
"""Where tests of the grip are slow on all but one, which is not the nominal one."""

HELD_S = 3.0
"""Of a grasp: enough for gaps of the size that tests ask for, in half the time."""

ARM = """
<mujoco model="arm"><worldbody>
  <body pos="0 0 1">
    <joint name="shoulder" axis="0 1 0" armature="0.02" damping="0.05"/>
    <inertial pos="0.15 0 0" mass="0.5" diaginertia="0.001 0.004 0.004"/>
    <body pos="0.3 0 0">
      <joint name="elbow" axis="0 1 0" armature="0.01" damping="0.03"/>
      <inertial pos="0.1 0 0" mass="0.3" diaginertia="0.001 0.002 0.002"/>
    </body>
  </body>
</worldbody></mujoco>
"""
DRIVES = {
    "shoulder": DriveSettings(kp=20.0, kd=0.5, limit=6.0),
    "elbow": DriveSettings(kp=12.0, kd=0.3, limit=3.0),
}
NOISE_RAD = 1e-4
REST = 400
"""Samples."""


def hand_log(path: Path, effects: str, protocol: str, channels: str = "push") -> Path:
    """A log of the hand in MuJoCo, as `bench record` writes it."""
    options = {"effects": effects, "protocol": protocol, "channels": channels, "workers": "1"}
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    assert cli.call(["record", "--backend", "mujoco", "--out", str(path), *words]) == 0
    return path


def with_short_grasps(log: Log) -> Log:
    """The log with the first `HELD_S` of every grasp, and all of its other episodes."""
    grasps = [one.episode for one in log.episodes if one.protocol == "grasp"]
    late = log.samples.episode.isin(grasps) & (log.samples.t_s >= HELD_S)
    return replace(log, samples=log.samples[~late])


def arm_log(
    effects: str, protocols: tuple[str, ...] = ("steps", "multisine"), gain: float = 1.0
) -> Log:
    """A log of the arm in MuJoCo with its gains so many times as large, read with some noise."""
    drives = {name: d.model_copy(update={"kp": gain * d.kp}) for name, d in DRIVES.items()}
    meta = LogMeta(
        schema=1,
        source="an arm",
        mechanism=MjcfMechanism(mjcf="arm.xml", joints=drives),
        episodes=tuple(EpisodeMeta(episode=k, protocol=p) for k, p in enumerate(protocols)),
    )
    joints = Joints(
        names=tuple(DRIVES),
        center_rad=np.zeros(2),
        range_rad=np.array([[-1.0, 1.0]] * 2),
        limit_nm=np.array([drive.limit for drive in DRIVES.values()]),
    )
    played = [FREE[p](joints) for p in protocols]
    asked = make_log(meta, pd.concat([_frame(k, _rested(m)) for k, m in enumerate(played)]), ARM)
    real = mjcf_world(asked)
    for effect in parse_effects(effects, real.hand):
        real = effect.on_spec(real)
    noise = np.random.default_rng(0)
    read = [r + noise.normal(0, NOISE_RAD, r.shape) for r in _played(real, asked)]
    frames = [_frame(k, m, r) for k, (m, r) in enumerate(zip(played, read, strict=True))]
    return make_log(meta, pd.concat(frames), ARM)


def _rested(motion: Excitation) -> Excitation:
    """The motion after a rest in which the arm settles under its weight."""
    rest = np.zeros(REST, dtype=int)
    return replace(
        motion,
        t_s=np.arange(REST + len(motion.t_s)) * motion.t_s[1],
        target_rad=np.concatenate([motion.target_rad[rest], motion.target_rad]),
        push_nm=np.concatenate([motion.push_nm[rest], motion.push_nm]),
    )


def _frame(episode: int, motion: Excitation, read_rad: np.ndarray | None = None) -> pd.DataFrame:
    read_rad = motion.target_rad if read_rad is None else read_rad
    columns: dict[str, object] = {"episode": episode, "t_s": motion.t_s}
    for j, name in enumerate(DRIVES):
        columns[f"command_rad.{name}"] = motion.target_rad[:, j]
        columns[f"position_rad.{name}"] = read_rad[:, j]
        columns[f"push_nm.{name}"] = motion.push_nm[:, j]
    return pd.DataFrame(columns)


def _played(spec: Spec, log: Log) -> list[np.ndarray]:
    """Positions in every episode after its rest."""
    engine = registry.load("backend", "mujoco")

    def start(specs):
        return simulate(engine, specs, 1)

    shown = replay(start, [spec], recordings(log, spec))
    return [positions[0, REST:, 0] for positions in shown]


def faults(log: Log, nominal: Spec) -> tuple[Fault, ...]:
    """The faults in the data of a log."""
    try:
        triage(log, nominal)
    except FaultError as error:
        return error.faults
    return ()
