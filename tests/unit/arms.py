"""Logs of arms of one to three joints in plain MuJoCo: real sides that no solver wrote."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
import pandas as pd

from backends.catalogue import catalogue
from diagnosis.logs.log import Log, LogMeta, make_log
from diagnosis.replay.nominal import mjcf_world
from diagnosis.solver import Judged, judged

TICK_S, HZ, SECONDS = 1e-3, 200, 4.0
KP, KD, LIMIT = 120.0, 6.0, 60.0
"""Nominal drives [Nm/rad, Nms/rad, Nm]."""
STILL_RAD, ARMATURE = 0.3, 0.02
LINKS = 0.3, 0.8
"""Length [m] and mass [kg] of every link."""
PROTOCOLS = ("steps", "triangle", "multisine")


@dataclass(frozen=True, kw_only=True)
class Real:
    """What an arm really is; by joint where a number may differ between them."""

    joints: int = 1
    kp: Mapping[int, float] = field(default_factory=dict)
    """Factors of the gain."""
    coulomb_nm: Mapping[int, float] = field(default_factory=dict)
    delay_s: float = 0.0
    limit_nm: float = LIMIT
    said_nm: float = LIMIT
    """What the file says of it."""
    said_kp: float | str = KP
    """What the file says of the gain."""
    spring_nm_rad3: float = 0.0
    """A cubic spring on the first joint: no effect of the catalogue."""
    lost_share: float = 0.0
    """Share of the packets that are lost; the drives keep the last target."""
    alone: bool = False
    """Whether each joint has packets, and loses them, by itself."""
    step_rad: float = 0.0
    """Targets of all joints are rounded to this on their way."""
    noise_rad: float = 1e-4
    armature_kgm2: float | None = None
    """Of every motor, which the file then does not say."""
    carried: float = 0.0
    """Share of all weight that its drives carry beside their laws."""
    stop_rad: float | None = None
    """Where the last joint meets a stop, which the file does not have."""
    option: str = f'timestep="{TICK_S / 2}" integrator="implicitfast"'
    """Of the simulator, which the file has as well."""
    integral_hz: float = 0.0
    """Gain of an integral in all drives, over kp [1/s]."""
    weakness: Mapping[int, float] = field(default_factory=dict)
    """Share of its torque that a motor lacks."""
    zero_rad: Mapping[int, float] = field(default_factory=dict)
    """By how much more than the angle a joint's drive and its sensor read."""
    still: tuple[int, ...] = ()
    """Joints whose target stays at STILL_RAD."""


def mjcf(
    joints: int,
    coulomb_nm: Mapping[int, float] | None = None,
    drives: str = "",
    option: str = Real.option,
    armature: float = ARMATURE,
    stop_rad: float | None = None,
) -> str:
    """A chain of equal links in a vertical plane."""
    length, mass = LINKS
    inertia = mass * length**2 / 12
    bodies = ""
    for j in range(joints):
        at = "0 0 0" if j == 0 else f"{length} 0 0"
        dry = (coulomb_nm or {}).get(j, 0.0)
        # A stiff, fast constraint: MuJoCo's default friction creeps.
        stiff = 'solreffriction="0.002 1" solimpfriction="0.999 0.9999 0.001"' if dry else ""
        if stop_rad is not None and j == joints - 1:
            stiff += f' range="-3 {stop_rad}" limited="true"'
        bodies += (
            f'<body pos="{at}"><joint name="J{j}" axis="0 1 0" armature="{armature}" '
            f'damping="0.05" frictionloss="{dry}" {stiff}/>'
            f'<inertial mass="{mass}" pos="{length / 2} 0 0" '
            f'diaginertia="1e-4 {inertia} {inertia}"/>'
        )
    head = f'<mujoco><compiler angle="radian"/><option {option}/><worldbody>'
    return f"{head}{bodies}{'</body>' * joints}</worldbody>{drives}</mujoco>"


def commands(joints: int) -> list[np.ndarray]:
    """One episode of every protocol at the log's rate, each (T, K) [rad]."""
    t = np.arange(int(SECONDS * HZ)) / HZ
    found = []
    for protocol in PROTOCOLS:
        columns = []
        for j in range(joints):
            shift = 0.3 * j
            if protocol == "steps":
                level = np.array([0.0, 0.4, -0.3, 0.2, -0.1])[(t / 0.8 + 0.1 * j).astype(int) % 5]
                columns.append(np.where(t < 0.5, 0.0, level))
            elif protocol == "triangle":
                columns.append(0.3 * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * t / (2.0 + shift))))
            else:
                waves = (np.sin(2 * np.pi * f * t + f + j) - np.sin(f + j) for f in (0.3, 0.9, 2.1))
                columns.append(0.1 * sum(waves))
        found.append(np.stack(columns, axis=1))
    return found


def log_of(real: Real, seed: int = 0) -> Log:
    """The log of an arm whose file says nothing of what `real` has."""
    noise = np.random.default_rng(seed)
    asked = commands(real.joints)
    for command in asked:
        command[:, list(real.still)] = STILL_RAD
    frames = [
        _frame(number, _simulated(real, _received(real, command, noise)), command, real, noise)
        for number, command in enumerate(asked)
    ]
    drives = {
        f"J{j}": {"kp": real.said_kp, "kd": KD, "limit": real.said_nm} for j in range(real.joints)
    }
    meta = {
        "schema": 1,
        "source": "test",
        "mechanism": {"mjcf": "arm.xml", "joints": drives},
        "episodes": [{"episode": n, "protocol": p} for n, p in enumerate(PROTOCOLS)],
    }
    armature = 0.0 if real.armature_kgm2 else ARMATURE
    xml = mjcf(real.joints, option=real.option, armature=armature)
    return make_log(LogMeta.model_validate(meta), pd.concat(frames), xml)


def limbs_of(log: Log) -> tuple[list[Judged], list[str]]:
    """What is said of the limbs of a log, with the fits that it rests on, and notes on the log."""
    return judged(log, (), mjcf_world(log), catalogue(), None, lambda text, share: None)


def _received(real: Real, command: np.ndarray, noise: np.random.Generator) -> np.ndarray:
    """The targets that arrive (T, K)."""
    packets = command.shape if real.alone else (len(command), 1)
    lost = noise.random(packets) < real.lost_share
    if real.step_rad:
        command = real.step_rad * np.round(command / real.step_rad)
    rows = np.where(lost, 0, np.arange(len(command))[:, None])
    return np.take_along_axis(command, np.maximum.accumulate(rows), axis=0)


def _simulated(real: Real, command: np.ndarray) -> np.ndarray:
    """Joint angles at the log's samples (T, K), in plain MuJoCo with its own actuators."""
    given = [1.0 - real.weakness.get(j, 0.0) for j in range(real.joints)]
    drives = "".join(
        f'<position joint="J{j}" kp="{g * KP * real.kp.get(j, 1.0)}" kv="{g * KD}" '
        f'forcerange="{-g * real.limit_nm} {g * real.limit_nm}"/>'
        for j, g in enumerate(given)
    )
    drives, armature = f"<actuator>{drives}</actuator>", real.armature_kgm2 or ARMATURE
    xml = mjcf(real.joints, real.coulomb_nm, drives, real.option, armature, real.stop_rad)
    for j, zero in real.zero_rad.items():
        xml = xml.replace(f'<joint name="J{j}"', f'<joint name="J{j}" ref="{zero}"')
    model = mujoco.MjModel.from_xml_string(xml.replace("<body", f'<body gravcomp="{real.carried}"'))
    data, shown = mujoco.MjData(model), []
    steps = round(1 / HZ / model.opt.timestep)
    late = round(real.delay_s / model.opt.timestep)
    data.qpos[:] = command[0]
    last, integral = 0.0, KP * real.integral_hz * model.opt.timestep
    for k in range(-3 * steps * HZ, steps * len(command)):
        if k >= 0 and k % steps == 0:
            shown.append(data.qpos.copy())
        data.ctrl[:] = command[max(k - late, 0) // steps]
        data.qfrc_applied[0] += real.spring_nm_rad3 * (last**3 - data.qpos[0] ** 3)
        data.qfrc_applied += integral * (data.ctrl - data.qpos)
        last = data.qpos[0]
        mujoco.mj_step(model, data)
    return np.array(shown)


def _frame(
    number: int, shown: np.ndarray, command: np.ndarray, real: Real, noise: np.random.Generator
) -> pd.DataFrame:
    read = shown + real.noise_rad * noise.standard_normal(shown.shape)
    columns = {"episode": np.full(len(read), number), "t_s": np.arange(len(read)) / HZ}
    for j in range(real.joints):
        columns |= {f"command_rad.J{j}": command[:, j], f"position_rad.J{j}": read[:, j]}
    return pd.DataFrame(columns)
