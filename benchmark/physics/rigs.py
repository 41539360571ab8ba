"""Small worlds with a closed form, as specs: an arm, a shelf, a pinch, a tree.

Fingertips, taxels and contacts are those of the hand, so the checks measure what tasks use.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backends import sticks, trx
from backends.effect import with_effects
from backends.engine import Engine
from backends.spec import Body, Contact, Drive, Fingertip, Joint, Spec, Stick, Timing, Vec3
from backends.state import Array
from benchmark.physics.rollout import UP
from benchmark.settings.effects import parse_effects

G_M_S2 = 9.81
DT_S = trx.spec(sticks.STICKS["reference"]).timing.drive_s
STICK = sticks.STICKS["reference"]
NO_DRIVE = Drive(
    kp_nm_rad=0.0,
    kd_nms_rad=0.0,
    torque_limit_nm=0.0,
    rotor_inertia_kgm2=1e-3,
    coulomb_nm=0.0,
    viscous_nms_rad=0.0,
    gear_stiffness_nm_rad=0.0,
    gear_damping_nms_rad=0.0,
    play_rad=0.0,
    lock_nm=0.0,
)
"""A motor without a gear to its joint, so that only the external torque acts on the joint."""
LEVER_M = 0.1
"""Distance from the pinching arm's hinge to the point where it presses."""
TOUCHING_M = trx.TIP_RADIUS_M + STICK.radius_m
"""Distance between the axes of fingertip and stick when they touch."""


def rig(
    bodies: Sequence[Body],
    tips: Sequence[Fingertip] = (),
    *,
    gravity_m_s2: Vec3 = (0.0, 0.0, -G_M_S2),
    stick: Stick = STICK,
    contact: Contact = trx.CONTACT,
    dt_s: float = DT_S,
    weightless_s: float = 0.0,
) -> Spec:
    """A world of these bodies that reports after every step."""
    driven = sum(body.joint.drive is not None for body in bodies)
    hand = dataclasses.replace(
        trx.HAND,
        name="rig",
        bodies=tuple(bodies),
        fingertips=tuple(tips),
        grasp_rad=(0.0,) * driven,
        preload_rad=(0.0,) * driven,
    )
    timing = Timing(drive_s=dt_s, policy_s=dt_s, weightless_s=weightless_s)
    return Spec(hand=hand, stick=stick, contact=contact, timing=timing, gravity_m_s2=gravity_m_s2)


def arm(
    drive: Drive = NO_DRIVE,
    *,
    axis: Vec3 = UP,
    mass_kg: float = 0.05,
    com_m: Vec3 = (0.0, 0.0, 0.0),
    inertia_kgm2: float = 2e-4,
    origin_m: Vec3 = (0.0, 0.0, 0.0),
) -> Body:
    """A link on a hinge."""
    joint = Joint(name="hinge", axis=axis, range_rad=(-3.0, 3.0), drive=drive)
    return Body(
        name="arm",
        parent=None,
        origin_m=origin_m,
        joint=joint,
        mass_kg=mass_kg,
        com_m=com_m,
        inertia_kgm2=(inertia_kgm2,) * 3,
    )


def post(name: str, origin_m: Vec3) -> Body:
    """A link that is fixed in the world."""
    joint = Joint(name=f"{name}_fixed", axis=UP, range_rad=(-1.0, 1.0), drive=None)
    return Body(
        name=name,
        parent=None,
        origin_m=origin_m,
        joint=joint,
        mass_kg=0.05,
        com_m=(0.0, 0.0, 0.0),
        inertia_kgm2=(1e-5,) * 3,
    )


def tip(body: str, middle_m: Vec3, forward: Vec3, inward: Vec3) -> Fingertip:
    """The hand's fingertip on a body, the middle of its cylinder at `middle_m` in that frame."""
    half = trx.TIP_LENGTH_M / 2
    x, y, z = (m + half * f for m, f in zip(middle_m, forward, strict=True))
    return dataclasses.replace(
        trx.HAND.fingertips[0],
        finger=body,
        body=body,
        center_m=(x, y, z),
        forward=forward,
        inward=inward,
    )


def pinch(
    *,
    gravity_m_s2: Vec3 = (0.0, 0.0, -G_M_S2),
    stick: Stick = STICK,
    torsion_radius_m: float = trx.CONTACT.torsion_radius_m,
    weightless_s: float = 0.1,
    dt_s: float = DT_S,
) -> Spec:
    """A stick between a fixed fingertip and one on an arm, crossed, at (LEVER_M, 0, 0).

    The arm's hinge lies in the tangent plane of its contact, so friction does not load the hinge. A
    torque of -N * LEVER_M presses with N, whatever the stick does.
    """
    tips = (
        tip("post", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        tip("arm", (LEVER_M, trx.TIP_RADIUS_M, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    )
    bodies = (
        post("post", (LEVER_M, -TOUCHING_M, 0.0)),
        arm(origin_m=(0.0, stick.radius_m, 0.0)),
    )
    contact = dataclasses.replace(trx.CONTACT, torsion_radius_m=torsion_radius_m)
    return rig(
        bodies,
        tips,
        gravity_m_s2=gravity_m_s2,
        stick=stick,
        contact=contact,
        dt_s=dt_s,
        weightless_s=weightless_s,
    )


def shelf(left_m: float, right_m: float) -> Spec:
    """Two fixed fingertips that carry a stick lying along x at height zero, and an idle arm."""
    bodies = [post(name, (x, 0.0, -TOUCHING_M)) for name, x in (("l", -left_m), ("r", right_m))]
    tips = [tip(body.name, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), UP) for body in bodies]
    return rig([*bodies, arm(origin_m=(0.0, 1.0, 0.0))], tips)


def tree(rng: np.random.Generator, joints: int = 5) -> Spec:
    """Links of random size on random axes with one branch; no number in it is zero or special."""
    bodies: list[Body] = []
    for i in range(joints):
        axis = rng.normal(size=3)
        mass = rng.uniform(0.02, 0.1)
        square = rng.uniform(0.01, 0.03, 3) ** 2
        parent = None if i == 0 else bodies[1 if i == 3 else i - 1].name
        joint = Joint(
            name=f"hinge{i}",
            axis=_vec(axis / np.linalg.norm(axis)),
            range_rad=(-3.0, 3.0),
            drive=NO_DRIVE,
        )
        bodies.append(
            Body(
                name=f"link{i}",
                parent=parent,
                origin_m=_vec(rng.uniform(-0.05, 0.05, 3)),
                joint=joint,
                mass_kg=float(mass),
                com_m=_vec(rng.uniform(-0.03, 0.03, 3)),
                inertia_kgm2=_vec(mass * (square.sum() - square)),
            )
        )
    return rig(bodies)


def _vec(values: Array) -> Vec3:
    x, y, z = (float(v) for v in values)
    return (x, y, z)


def hand(effects: str = "none", dt_s: float = DT_S) -> Spec:
    """The hand with effects as on the command line."""
    spec = trx.spec(STICK)
    spec = with_effects(spec, parse_effects(effects, spec.hand))
    return dataclasses.replace(spec, timing=dataclasses.replace(spec.timing, drive_s=dt_s))


def spinning(spec: Spec, engine: type[Engine], radius_m: float) -> Spec:
    """A world whose contacts have this radius of spin friction in an engine."""
    lacks = "taken as 0" in engine.support["contact.torsion_radius_m"]
    more_m = radius_m - (0.0 if lacks else spec.contact.torsion_radius_m)
    contact = dataclasses.replace(spec.contact, spin_radius_m=more_m)
    return dataclasses.replace(spec, contact=contact)


def loose(spec: Spec) -> Spec:
    """A world without drives and without the weightless start that reports after every step."""
    dt_s = spec.timing.drive_s
    timing = Timing(drive_s=dt_s, policy_s=dt_s, weightless_s=0.0)
    return dataclasses.replace(spec.with_drives(NO_DRIVE for _ in spec.drives), timing=timing)


def under(spec: Spec, gravity_m_s2: Array) -> Spec:
    """A world with another gravity."""
    return dataclasses.replace(spec, gravity_m_s2=_vec(gravity_m_s2))


def frictionless(spec: Spec) -> Spec:
    """A world without Coulomb friction: at rest its motors carry the load alone."""
    return spec.with_drives(dataclasses.replace(d, coulomb_nm=0.0) for d in spec.drives)
