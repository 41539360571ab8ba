"""The TRX hand of the paper as numbers.

Three two-link fingers reach along +x from a vertical palm; flexion axes are vertical. Fingers 1 and
2 (with the spread joints J2 and J5, fixed at zero) oppose finger 3, the thumb. J0, J3 and J6 are
worm-geared. The numbers describe the *ideal* hand: backlash and self-lock are added as effects.

The paper gives the joints, 128 taxels per tip, at most 15 N per tip and 1 mm of skin compliance. It
gives no link sizes; with the sizes here policies learn the task. The flat tips of 18 mm matter: on
9 mm tips a thin stick is pinched in an unstable equilibrium and a fifth of all episodes end in a
drop. The preload matters too: policies trained with half of it drop the stick twice as often in
other engines.
"""

import math

from backends.spec import (
    Body,
    Contact,
    Drive,
    Fingertip,
    Hand,
    Joint,
    Spec,
    Stick,
    Taxels,
    Timing,
    Vec3,
)

PROXIMAL_M = 0.045
DISTAL_M = 0.038
TIP_RADIUS_M = 0.018
TIP_LENGTH_M = 0.012
GEAR_INERTIA_KGM2 = 5e-5
"""Gear inertia about the hinge on the output side; without it the links would need half the time
step."""

PROXIMAL_DRIVE = Drive(
    kp_nm_rad=6.0,
    kd_nms_rad=0.15,
    torque_limit_nm=1.2,
    rotor_inertia_kgm2=2e-4,
    coulomb_nm=0.02,
    viscous_nms_rad=0.0,
    gear_stiffness_nm_rad=20.0,
    gear_damping_nms_rad=0.04,
    play_rad=0.0,
    lock_nm=0.0,
)
DISTAL_DRIVE = Drive(
    kp_nm_rad=3.0,
    kd_nms_rad=0.08,
    torque_limit_nm=0.6,
    rotor_inertia_kgm2=2e-4,
    coulomb_nm=0.005,
    viscous_nms_rad=0.0,
    gear_stiffness_nm_rad=8.0,
    gear_damping_nms_rad=0.015,
    play_rad=0.0,
    lock_nm=0.0,
)


def _rod(mass_kg: float, length_m: float, radius_m: float) -> Vec3:
    """Principal inertias [kg m^2] of a solid cylinder along x."""
    across = mass_kg * (3 * radius_m**2 + length_m**2) / 12
    return (mass_kg * radius_m**2 / 2, across, across)


def _geared(inertia: Vec3) -> Vec3:
    """Add the gear's inertia to every axis.

    Only the hinge axis moves, and a rigid body needs A + B >= C.
    """
    return (
        inertia[0] + GEAR_INERTIA_KGM2,
        inertia[1] + GEAR_INERTIA_KGM2,
        inertia[2] + GEAR_INERTIA_KGM2,
    )


def _distal(name: str, parent: str, joint: Joint) -> Body:
    """The distal link (15 g rod) and its fingertip (8 g ball), one rigid body."""
    link_kg, tip_kg = 0.015, 0.008
    tip_m = DISTAL_M - TIP_LENGTH_M / 2
    mass = link_kg + tip_kg
    com = (link_kg * DISTAL_M / 2 + tip_kg * tip_m) / mass
    rod = _rod(link_kg, DISTAL_M, 0.008)
    ball = 0.4 * tip_kg * TIP_RADIUS_M**2
    steiner = link_kg * (DISTAL_M / 2 - com) ** 2 + tip_kg * (tip_m - com) ** 2
    inertia = (rod[0] + ball, rod[1] + ball + steiner, rod[2] + ball + steiner)
    return Body(
        name=name,
        parent=parent,
        origin_m=(PROXIMAL_M, 0.0, 0.0),
        joint=joint,
        mass_kg=mass,
        com_m=(com, 0.0, 0.0),
        inertia_kgm2=_geared(inertia),
    )


def _finger(name: str, base_m: Vec3, joints: tuple[str, str], spread: str | None) -> list[Body]:
    """The bodies of one finger; positive flexion curls it towards y = 0."""
    axis = (0.0, 0.0, -math.copysign(1.0, base_m[1]))
    bodies, parent, origin = [], None, base_m
    if spread is not None:
        fixed = Joint(name=spread, axis=(1.0, 0.0, 0.0), range_rad=(0.0, math.pi / 2), drive=None)
        bodies.append(
            Body(
                name=f"{name}_base",
                parent=None,
                origin_m=base_m,
                joint=fixed,
                mass_kg=0.04,
                com_m=(0.0, 0.0, 0.0),
                inertia_kgm2=(4e-6, 4e-6, 4e-6),
            )
        )
        parent, origin = f"{name}_base", (0.0, 0.0, 0.0)
    proximal = Joint(
        name=joints[0], axis=axis, range_rad=(-1.2, 1.2), drive=PROXIMAL_DRIVE, gear="worm"
    )
    distal = Joint(name=joints[1], axis=axis, range_rad=(-0.3, 1.8), drive=DISTAL_DRIVE)
    bodies.append(
        Body(
            name=f"{name}_proximal",
            parent=parent,
            origin_m=origin,
            joint=proximal,
            mass_kg=0.03,
            com_m=(PROXIMAL_M / 2, 0.0, 0.0),
            inertia_kgm2=_geared(_rod(0.03, PROXIMAL_M, 0.009)),
        )
    )
    bodies.append(_distal(f"{name}_distal", f"{name}_proximal", distal))
    return bodies


def _tip(name: str, side: float) -> Fingertip:
    return Fingertip(
        finger=name,
        body=f"{name}_distal",
        center_m=(DISTAL_M, 0.0, 0.0),
        forward=(1.0, 0.0, 0.0),
        inward=(0.0, -side, 0.0),
        radius_m=TIP_RADIUS_M,
        length_m=TIP_LENGTH_M,
    )


HAND = Hand(
    name="trx",
    palm_center_m=(-0.02, 0.0, 0.0),
    palm_half_size_m=(0.006, 0.04, 0.045),
    bodies=(
        *_finger("finger1", (0.0, 0.022, 0.018), ("J0", "J1"), "J2"),
        *_finger("finger2", (0.0, 0.022, -0.018), ("J3", "J4"), "J5"),
        *_finger("finger3", (0.0, -0.022, 0.0), ("J6", "J7"), None),
    ),
    fingertips=(_tip("finger1", 1.0), _tip("finger2", 1.0), _tip("finger3", -1.0)),
    taxels=Taxels(
        rows=16,
        columns=8,
        front_rad=math.radians(75),
        half_width_rad=math.radians(32),
        reach_m=1e-3,
    ),
    grip_m=(0.068, 0.0, 0.0),
    grasp_rad=(-0.561, 1.226) * 3,
    preload_rad=(0.07, 0.07, 0.07, 0.07, 0.14, 0.14),
)

CONTACT = Contact(torsion_radius_m=3e-3, time_constant_s=4e-3)


def spec(stick: Stick) -> Spec:
    """The ideal TRX hand holding `stick`."""
    return Spec(hand=HAND, stick=stick, contact=CONTACT, timing=Timing())
