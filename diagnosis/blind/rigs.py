"""The mechanisms of the blind check: all that maker and solver both know beside the log format.

A log names its rig; the numbers here are its data sheet. Real sides differ from it by nominal
errors within the log's uncertainty, and by what is hidden.
"""

import dataclasses
from collections.abc import Callable

from backends import trx
from backends.spec import Body, Drive, Encoder, Fingertip, Joint, Spec
from backends.sticks import STICKS

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
"""Rigs in free air, and those that hold the stick in some episodes."""
RIGS = (*FREE, *HOLDING)


def nominal(rig: str) -> Spec:
    """The nominal world of a rig: what a solver is told of the mechanism."""
    spec = (FREE | HOLDING)[rig]()
    encoder = Encoder(noise_rad=NOISE_RAD)
    return spec.with_driven(
        dataclasses.replace(b, joint=dataclasses.replace(b.joint, encoder=encoder))
        for b in spec.hand.driven
    )
