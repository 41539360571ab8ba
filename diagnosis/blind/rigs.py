"""The mechanisms of the blind check: what maker and solver both know, besides the log format.

A log names its rig, and the numbers here are its data sheet. Real sides differ from it by nominal
errors within the log's uncertainty and by the hidden effects.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from backends import trx
from backends.spec import Body, Drive, Fingertip, Joint, Spec
from backends.sticks import STICKS
from diagnosis.blind import arms
from diagnosis.logs.log import HandMechanism, MjcfMechanism

NOISE_RAD = 5e-4
"""Noise of every position sensor by its data sheet [rad], standard deviation."""
TRACKER_M, TRACKER_RAD = 1e-4, 1e-3
"""Noise of the stick's tracker by its data sheet, standard deviations."""


_ARM_DRIVE = Drive(
    kp_nm_rad=8.0,
    kd_nms_rad=0.18,
    torque_limit_nm=1.5,
    rotor_inertia_kgm2=1e-3,
    coulomb_nm=0.02,
    viscous_nms_rad=0.02,
    gear_stiffness_nm_rad=60.0,
    gear_damping_nms_rad=0.1,
    play_rad=0.0,
    lock_nm=0.0,
)
_ARM = Body(
    name="arm",
    parent=None,
    origin_m=(0.0, 0.0, 0.0),
    joint=Joint(
        name="A0", axis=(0.0, 1.0, 0.0), range_rad=(-1.2, 1.2), drive=_ARM_DRIVE, gear="worm"
    ),
    mass_kg=0.25,
    com_m=(0.08, 0.0, 0.0),
    inertia_kgm2=(5e-5, 5.5e-4, 5.5e-4),
)
_ARM_TIP = Fingertip(
    finger="arm",
    body="arm",
    center_m=(0.16, 0.0, 0.0),
    forward=(1.0, 0.0, 0.0),
    inward=(0.0, 1.0, 0.0),
    radius_m=0.01,
    length_m=0.01,
)


def _hand() -> Spec:
    """The TRX hand: three fingers of two coupled joints."""
    return trx.spec(STICKS["reference"])


def _finger() -> Spec:
    """One finger of it: two coupled joints, gravity along their axes."""
    tip = trx.HAND.fingertips[0]
    bodies = tuple(b for b in trx.HAND.bodies if b.name.startswith(tip.finger))
    return _with_hand("finger", bodies, tip)


def _joint() -> Spec:
    """One hinge that carries an arm against gravity."""
    return _with_hand("joint", (_ARM,), _ARM_TIP)


def _with_hand(name: str, bodies: tuple[Body, ...], tip: Fingertip) -> Spec:
    driven = sum(b.joint.drive is not None for b in bodies)
    hand = dataclasses.replace(
        trx.HAND,
        name=name,
        bodies=bodies,
        fingertips=(tip,),
        grasp_rad=trx.HAND.grasp_rad[:driven],
        preload_rad=trx.HAND.preload_rad[:driven],
    )
    return dataclasses.replace(trx.spec(STICKS["reference"]), hand=hand)


FREE: dict[str, Callable[[], Spec]] = {"finger": _finger, "hand": _hand, "joint": _joint}
HOLDING: dict[str, Callable[[], Spec]] = {"held": _hand}
ARMS = {"arm1": 1, "arm2": 2, "arm3": 3, "arm6": 6}
"""Number of joints of arms that are drawn; `arm` stands for those of two and more."""
RIGS = (*FREE, *HOLDING)
"""Rigs in free air, and those that hold the stick in some episodes."""
DRAWN = ("arm", *ARMS)
"""Rigs in free air that are drawn for every case: each is one robot."""
RATE_HZ = 200.0
"""Samples per second of a hand's log."""
TORQUE_NOISE = 0.02
"""Noise of a hand's logged torque over the drive's limit, standard deviation."""


def members(names: Sequence[str]) -> tuple[str, ...]:
    """Rigs by name; `arm` is replaced by its members."""
    several = (name for name, joints in ARMS.items() if joints > 1)
    return tuple(dict.fromkeys(n for one in names for n in (several if one == "arm" else [one])))


def individual(name: str, rng: np.random.Generator) -> str:
    """The rig itself, or one arm of its kind, such as `arm2-1234`."""
    return f"{name}-{rng.integers(1 << 32)}" if name in ARMS else name


def family(rig: str) -> str:
    """The kind of a rig: `arm2` of `arm2-1234`."""
    return rig.split("-")[0]


def arms_of(names: Sequence[str]) -> list[str]:
    """Of arms that are drawn one of each kind."""
    rng = np.random.default_rng(0)
    return [individual(name, rng) for name in members(names) if name in ARMS]


def robot(rig: str) -> int | None:
    """The seed of a drawn arm, which is one robot; None for a rig that is always the same."""
    return int(rig.split("-")[1]) if "-" in rig else None


def nominal(rig: str) -> Spec:
    """The nominal world of a rig: what a solver knows about the mechanism."""
    seed = robot(rig)
    if seed is not None:
        return arms.spec(ARMS[family(rig)], seed)
    return arms.with_noise((FREE | HOLDING)[rig](), NOISE_RAD)


def rate_hz(rig: str) -> float:
    """Samples per second of a rig's log."""
    seed = robot(rig)
    return RATE_HZ if seed is None else arms.sheet(ARMS[family(rig)], seed).rate_hz


def torque_noise(rig: str) -> float:
    """Noise of a rig's logged torque over the drive's limit, standard deviation."""
    return TORQUE_NOISE if robot(rig) is None else arms.TORQUE_NOISE


def described(rig: str) -> tuple[HandMechanism | MjcfMechanism, str | None]:
    """The description of a rig in a log: its mechanism, and the text of an MJCF file."""
    seed = robot(rig)
    if seed is None:
        return HandMechanism(hand=rig), None
    joints = ARMS[family(rig)]
    return arms.described(joints, seed), arms.mjcf(arms.sheet(joints, seed))
