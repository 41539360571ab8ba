"""Arms of the blind check: a random data sheet, its MJCF file, and a robot that differs from it.

An arm is a pure function of its number of joints and a seed, so its name defines it: `arm2-1234`.
Links are rods. Gains give the drives a bandwidth of 3 to 6 Hz. Limits are at least twice the
gravity torques. Arms of one and two joints have parallel hinges, vertical or horizontal; the first
hinge of arms with three and six joints is vertical.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from backends.mjcf import mechanism
from backends.spec import Encoder, Spec
from backends.state import Array
from diagnosis.logs.log import DriveSettings, MjcfMechanism

FILE = "arm.xml"
RATES_HZ = (50.0, 100.0, 200.0, 250.0, 500.0)
"""Sample rates of logs."""
NOISES_RAD = (5e-5, 1e-4, 3e-4)
"""White noise of encoders, standard deviation."""
TORQUE_NOISE = 2e-3
"""Noise of a logged torque over the drive's limit, standard deviation."""
ROOM_RAD = (0.4, 1.1)
"""Half of the range in which a joint is moved."""
GRAVITY_M_S2 = 9.81
UNCERTAIN, UNCERTAIN_MORE, MORE_SHARE = 0.05, 0.10, 0.25
"""Standard deviation of nominal errors; in a share of the robots it is larger than their file
says."""
CLIP = 0.15
"""Where nominal errors end: three of the standard deviations that a log states."""


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Numbers of an arm of K joints; arrays have shape (K,)."""

    length_m: Array
    mass_kg: Array
    axes: tuple[str, ...]
    armature_kgm2: Array
    kp_nm_rad: Array
    kd_nms_rad: Array
    limit_nm: Array
    viscous_nms_rad: Array
    coulomb_nm: Array
    home_rad: Array
    """Centre of the range in which a joint is moved."""
    room_rad: Array
    """Half of that range."""
    rate_hz: float
    noise_rad: float


@lru_cache(maxsize=64)
def sheet(joints: int, seed: int) -> Sheet:
    """The data sheet of an arm."""
    rng = np.random.default_rng([seed, joints])
    size = rng.uniform(0.1, 0.4) if joints < 6 else 0.3
    length = size * np.linspace(1.2, 0.6, joints)
    mass = np.exp(rng.normal(0, 0.3, joints)) * 3.0 * size * np.linspace(1.5, 0.5, joints)
    at = np.concatenate([[0.0], np.cumsum(length)])  # hinges of the stretched arm
    arms = [(mass[k], at[k] + length[k] / 2 - at[:joints]) for k in range(joints)]
    inertia = sum(m * arm**2 * (arm > 0) for m, arm in arms)
    weight = sum(GRAVITY_M_S2 * m * arm * (arm > 0) for m, arm in arms)
    rotor = inertia * rng.uniform(0.3, 1.0, joints) + 1e-4
    moved = inertia + rotor
    pace = 2 * np.pi * rng.uniform(3, 6, joints)
    kp = moved * pace**2
    limit = 2.0 * weight + 0.17 * kp * rng.uniform(0.6, 1.2, joints)
    return Sheet(
        length_m=length,
        mass_kg=mass,
        axes=_axes(joints, rng),
        armature_kgm2=rotor,
        kp_nm_rad=kp,
        kd_nms_rad=1.4 * pace * moved * rng.uniform(0.5, 1.0, joints),
        limit_nm=limit,
        viscous_nms_rad=0.02 * pace * moved,
        coulomb_nm=limit * rng.choice([0.0, 0.002, 0.006, 0.015]) * rng.uniform(0.7, 1.3, joints),
        home_rad=rng.uniform(-0.4, 0.4, joints),
        room_rad=rng.uniform(*ROOM_RAD, joints),
        rate_hz=float(rng.choice(RATES_HZ)),
        noise_rad=float(rng.choice(NOISES_RAD)),
    )


def _axes(joints: int, rng: np.random.Generator) -> tuple[str, ...]:
    upright, level = "0 0 1", "0 1 0"
    if joints <= 2:
        return (str(rng.choice([upright, level, level])),) * joints
    last = rng.choice([level, level, upright], joints - 3)
    return (upright, level, level, *map(str, last))


def spec(joints: int, seed: int) -> Spec:
    """The nominal world of an arm, in the range in which it is moved."""
    of = sheet(joints, seed)
    return with_noise(mechanism(mjcf(of), _servos(of)), of.noise_rad)


def with_noise(world: Spec, noise_rad: float) -> Spec:
    """The world with encoders that have noise, and nothing else."""
    encoder = Encoder(noise_rad=noise_rad)
    return world.with_driven(
        replace(body, joint=replace(body.joint, encoder=encoder)) for body in world.hand.driven
    )


def described(joints: int, seed: int) -> MjcfMechanism:
    """How a log describes an arm."""
    return MjcfMechanism(mjcf=FILE, joints=_servos(sheet(joints, seed)))


def _servos(of: Sheet) -> dict[str, DriveSettings]:
    rows = zip(of.kp_nm_rad, of.kd_nms_rad, of.limit_nm, strict=True)
    return {
        f"j{j}": DriveSettings(kp=float(kp), kd=float(kd), limit=float(limit))
        for j, (kp, kd, limit) in enumerate(rows)
    }


def mjcf(of: Sheet) -> str:
    """The MJCF file of an arm: its links, and what its motors have."""
    links, low, high = "", of.home_rad - of.room_rad, of.home_rad + of.room_rad
    for j, (length, mass) in enumerate(zip(of.length_m, of.mass_kg, strict=True)):
        place = "0 0 0.3" if j == 0 else f"{of.length_m[j - 1]:.6g} 0 0"
        across = mass * length**2 / 12
        links += (
            f'<body name="link{j}" pos="{place}"><inertial mass="{mass:.6g}" '
            f'pos="{length / 2:.6g} 0 0" '
            f'diaginertia="{across / 10:.6g} {across:.6g} {across:.6g}"/>'
            f'<joint name="j{j}" axis="{of.axes[j]}" range="{low[j]:.6g} {high[j]:.6g}" '
            f'armature="{of.armature_kgm2[j]:.6g}" '
            f'damping="{of.viscous_nms_rad[j]:.6g}" frictionloss="{of.coulomb_nm[j]:.6g}"/>'
        )
    ends = "</body>" * len(of.mass_kg)
    head = '<mujoco model="arm"><compiler angle="radian"/>'
    return f"{head}<worldbody>{links}{ends}</worldbody></mujoco>\n"


def spread(seed: int) -> float:
    """Standard deviation of the nominal errors of the robot with this seed, relative."""
    more = np.random.default_rng([seed, 1]).random() < MORE_SHARE
    return UNCERTAIN_MORE if more else UNCERTAIN
