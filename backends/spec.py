"""The simulated rig as numbers: hand, drives, stick, taxels, contact and timing.

All numbers are in SI units. World frame: z up, right-handed. Every body frame is parallel to the
world frame at the zero pose, so an origin and an axis define a joint completely. Nothing in this
module knows an engine.
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

Vec3 = tuple[float, float, float]
_ZEROS = (0.0, (0.0, 0.0, 0.0), None, ())


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The drive of a joint: a PD controller, its rotor, and a gear with play."""

    kp_nm_rad: float
    """Proportional gain on the motor angle [Nm/rad]."""
    kd_nms_rad: float
    """Derivative gain on the motor speed [Nms/rad]."""
    torque_limit_nm: float
    """Largest PD torque in either direction [Nm]."""
    rotor_inertia_kgm2: float
    """Rotor inertia reflected to the joint [kg m^2]."""
    coulomb_nm: float
    """Coulomb friction torque on the motor side [Nm]."""
    viscous_nms_rad: float
    """Viscous friction on the motor side [Nms/rad]."""
    gear_stiffness_nm_rad: float
    """Stiffness of the teeth once they touch [Nm/rad]."""
    gear_damping_nms_rad: float
    """Damping of the teeth once they touch [Nms/rad]."""
    play_rad: float
    """Half of the gear play: the joint moves freely within +-play about the motor angle [rad]."""
    lock_nm: float
    """Largest load the gear holds when it is back-driven [Nm]; 0: freely back-drivable."""
    stiction_nm: float = 0.0
    """Friction at standstill in addition to Coulomb friction; it falls with speed (Stribeck)
    [Nm]."""
    load_friction: float = 0.0
    """Friction torque per unit of torque that the gear transmits [1]."""
    dead_zone_rad: float = 0.0
    """Dead zone: the PD law subtracts this from the size of an error; smaller errors count as 0
    [rad]."""
    one_way_friction_nm: float = 0.0
    """Coulomb friction in one direction alone: where the motor turns upwards if positive, of this
    size where it turns downwards if negative [Nm]."""
    limit_fall_nms_rad: float = 0.0
    """Torque by which the limit falls per speed of the motor, as its back-EMF takes the voltage
    [Nms/rad]; the limit over it is the no-load speed."""
    cogging_nm: float = 0.0
    """Cogging: amplitude of a torque on the motor that is a sine of its angle [Nm]."""
    cogging_period_rad: float = 0.0
    """Its period, at the joint; 0: `drive.COGGING_RAD` [rad]."""
    cogging_phase_rad: float = 0.0
    """Phase of the sine at the angle zero [rad]."""
    end_stop_rad: float = 0.0
    """How far inside of the upper end of the joint's range an elastic stop stands if positive, of
    the lower end if negative [rad]; 0: there is none."""
    end_stop_nm_rad: float = 0.0
    """Stiffness of that stop; 0: that of the teeth [Nm/rad]."""
    thermal_fade: float = 0.0
    """Share of its torque that the motor loses at the heat of lasting torque at its limit [1]."""
    thermal_s: float = 0.0
    """Time constant of that heat; 0: `drive.HEAT_S` [s]."""
    presliding_nm: float = 0.0
    """Dry friction on the motor side whose bristles bend before they slide [Nm]."""
    presliding_rad: float = 0.0
    """How far they bend; 0: `drive.BRISTLE_RAD` [rad]."""
    spring_nm_rad: float = 0.0
    """Stiffness of a spring beside the drive, from the joint's link to the one before it
    [Nm/rad]."""
    spring_rest_rad: float = 0.0
    """Where that spring pushes nothing [rad]."""
    zero_rad: float = 0.0
    """Angle by which the drive counts the joint's from another zero: its own sensor, and the one of
    policies and logs, read so much more [rad]."""
    weakness: float = 0.0
    """Share of the torque that is asked of the motor, and read, that it does not give [1]."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """The path of a joint's target to the drive; zeros leave the target unchanged."""

    delay_s: float = 0.0
    """The drive follows the target with this delay [s]."""
    slowness_s_rad: float = 0.0
    """Shortest time in which the target moves by one radian [s/rad]; 0: no limit."""
    loss_share: float = 0.0
    """Probability that a policy period's target is lost and the last one kept [1]."""
    resolution_rad: float = 0.0
    """Targets are rounded to multiples of this step [rad]; 0: continuous."""
    jitter_s: float = 0.0
    """A policy period's target comes late by a random time up to this [s]."""


@dataclass(frozen=True, kw_only=True)
class Loop:
    """What a user's drive does beside the PD law and the laws of `Drive`; zeros add nothing."""

    integral_hz: float = 0.0
    """Integral gain over the proportional one [1/s]."""
    speed_integral_hz: float = 0.0
    """Integral gain over the proportional one of a loop on the speed [1/s]: in a cascade, whose
    target speed is the proportional gain over the derivative one times the error."""
    integral_limit_nm: float = 0.0
    """Largest torque of the integral [Nm]; 0: the drive's limit."""
    filter_s: float = 0.0
    """Time constant of the low-pass filter on the speed that the derivative gain takes [s]."""
    lead: float = 0.0
    """Share of the target's speed that the derivative gain follows [1]; 1: it takes the speed's
    error."""
    profile_rad_s2: float = 0.0
    """Acceleration by which the drive itself moves the target to a command [rad/s^2]; 0: it
    jumps."""
    lag_s: float = 0.0
    """Time constant by which the torque follows what is asked of it [s]."""
    hold_s: float = 0.0
    """Period in which the law acts once, and its torque holds [s]; 0: no slower than its engine."""
    unlimited: float = 0.0
    """Share of the derivative gain that the torque limit does not hold, as a motor's back-EMF
    [1]."""
    open: float = 0.0
    """1: no position is fed back, and the proportional gain is of the torque that is given beside
    the target [1]."""
    soft_friction: float = 0.0
    """How far dry friction yields under load as MuJoCo's own does [1]; 0: it holds."""


@dataclass(frozen=True, kw_only=True)
class Encoder:
    """The errors of a position sensor; zeros mean that it reads the angle.

    Policies and logs read this sensor. The motor's own control loop has another one.
    """

    bias_rad: float = 0.0
    """Constant that is added to every reading [rad]."""
    scale_error: float = 0.0
    """Readings are larger by this share [1]."""
    resolution_rad: float = 0.0
    """Readings are multiples of this step [rad]; 0: continuous."""
    noise_rad: float = 0.0
    """Standard deviation of the white noise on every reading [rad]."""
    delay_s: float = 0.0
    """Age of a reading at the moment it is read [s]."""
    eccentricity_rad: float = 0.0
    """Error once per turn: the part that goes as the cosine of the angle [rad]."""
    eccentricity_sine_rad: float = 0.0
    """The part of it that goes as the sine, a quarter turn on [rad]."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A hinge or slide: its axis, range and drive.

    A joint without a drive follows another, or is fixed at zero.

    For a slide, read metres for radians and newtons for newton metres, here and in its drive.
    """

    name: str
    axis: Vec3
    """Unit joint axis in the body frame."""
    range_rad: tuple[float, float]
    """Range that normalises the observed position and bounds the target [rad]."""
    drive: Drive | None
    gear: str = "spur"
    """Kind of gear: 'worm' (backlash and self-lock are expected) or 'spur'."""
    sensor: str = "joint"
    """Side of the gear on which the position sensor sits: 'joint' or 'motor'."""
    encoder: Encoder = Encoder()
    command: Command = Command()
    loop: Loop = Loop()
    slides: bool = False
    """Whether it moves along its axis instead of rotating about it."""
    follows: str | None = None
    """The driven joint that it follows, as a coupled finger does; then it has no drive."""
    course: tuple[float, ...] = ()
    """Coefficients of its position as a polynomial of that joint's, the lowest first [rad, m]."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid link and the joint that carries it."""

    name: str
    parent: str | None
    """Body that carries this one; None: the palm, which is fixed in the world."""
    origin_m: Vec3
    """Joint position in the parent's frame [m]."""
    joint: Joint
    mass_kg: float
    com_m: Vec3
    """Centre of mass in the body frame [m]."""
    inertia_kgm2: Vec3
    """Moments of inertia about the centre of mass, axes parallel to the body frame [kg m^2]."""
    products_kgm2: Vec3 = (0.0, 0.0, 0.0)
    """Entries xy, xz and yz of the inertia tensor [kg m^2]."""
    carried: float = 0.0
    """Share of its weight that is carried beside the drives' laws: gravity compensation [1]."""
    payload: float = 0.0
    """Mass of a point that it carries, over its own mass [1]."""
    payload_x_m: float = 0.0
    """How far from its end that point is, in the body frame [m]; likewise along y and z."""
    payload_y_m: float = 0.0
    payload_z_m: float = 0.0
    tip_m: Vec3 | None = None
    """Its end in the body frame [m]; None: twice as far as its centre of mass, as of a rod."""

    @property
    def end_m(self) -> Vec3:
        """Its end in the body frame [m]."""
        return self.tip_m or (2 * self.com_m[0], 2 * self.com_m[1], 2 * self.com_m[2])

    @property
    def payload_m(self) -> Vec3:
        """Where it carries a payload, in the body frame [m]."""
        x, y, z = self.end_m
        return (x + self.payload_x_m, y + self.payload_y_m, z + self.payload_z_m)

    @property
    def reach_m(self) -> float:
        """How far it reaches from its joint: its end, or its radius of gyration [m]."""
        about = sum(self.inertia_kgm2) / (2 * self.mass_kg) if self.mass_kg else 0.0
        return max(math.hypot(*self.end_m), math.sqrt(about))

    @property
    def loaded(self) -> "Body":
        """The body with its payload as a part of it (parallel axes)."""
        if not self.payload:
            return self
        share = self.payload / (1.0 + self.payload)
        x, y, z = (end - own for own, end in zip(self.com_m, self.payload_m, strict=True))
        reduced = share * self.mass_kg
        xx, yy, zz = self.inertia_kgm2
        xy, xz, yz = self.products_kgm2
        cx, cy, cz = self.com_m
        return dataclasses.replace(
            self,
            payload=0.0,
            payload_x_m=0.0,
            payload_y_m=0.0,
            payload_z_m=0.0,
            mass_kg=(1.0 + self.payload) * self.mass_kg,
            com_m=(cx + share * x, cy + share * y, cz + share * z),
            inertia_kgm2=(
                xx + reduced * (y * y + z * z),
                yy + reduced * (x * x + z * z),
                zz + reduced * (x * x + y * y),
            ),
            products_kgm2=(xy - reduced * x * y, xz - reduced * x * z, yz - reduced * y * z),
        )


@dataclass(frozen=True, kw_only=True)
class Fingertip:
    """The curved, touch-sensitive end of a finger: a capsule along the distal link.

    Its frame: origin at the centre of the front hemisphere, x forward along the link, y inward
    towards the object, z = x cross y.
    """

    finger: str
    body: str
    center_m: Vec3
    """Centre of the front hemisphere in the body frame [m]."""
    forward: Vec3
    inward: Vec3
    radius_m: float
    length_m: float
    """Distance between the centres of the rear and the front hemisphere [m]."""


@dataclass(frozen=True, kw_only=True)
class Taxels:
    """Touch elements of one fingertip: a grid on its inner and front surface."""

    rows: int
    """Rows along the finger, from the rear of the pad to its front."""
    columns: int
    """Columns across the finger."""
    front_rad: float
    """Angle by which the pad reaches onto the front hemisphere, from inward towards forward
    [rad]."""
    half_width_rad: float
    """Half of the angle that the pad covers across the finger [rad]."""
    reach_m: float
    """A taxel is active when the object is nearer than this; it models the skin's compliance
    [m]."""
    threshold_m: float = 0.0
    """Additional pressed depth that a taxel needs to count as active [m]."""
    drift_m_s: float = 0.0
    """Fastest drift of a reading from the start of the episode, as pressed depth per time [m/s]."""
    dead_share: float = 0.0
    """Share of the taxels that are dead [1]."""
    halo_m: float = 0.0
    """Taxels nearer than this to an active one respond too [m]."""
    gain_spread: float = 0.0
    """The gain of a taxel differs from 1 by up to this share [1]."""
    hysteresis: float = 0.0
    """While a press eases, a reading stays until it is larger than the depth by this share [1]."""


@dataclass(frozen=True, kw_only=True)
class Hand:
    """A hand: bodies in kinematic order, fingertips, taxels and its grasp of the stick."""

    name: str
    palm_center_m: Vec3
    palm_half_size_m: Vec3
    bodies: tuple[Body, ...]
    fingertips: tuple[Fingertip, ...]
    taxels: Taxels
    grip_m: Vec3
    """Point at which the stick is pinched: the pivot of every task [m]."""
    grasp_rad: tuple[float, ...]
    """Driven joint angles of the nominal grasp, spec order [rad]."""
    preload_rad: tuple[float, ...]
    """Target minus position at the start of an episode; it sets the squeeze [rad]."""

    @cached_property
    def driven(self) -> tuple[Body, ...]:
        """Bodies whose joint has a drive, in spec order; J in (N, J) is their number."""
        return tuple(b for b in self.bodies if b.joint.drive is not None)

    @cached_property
    def ends(self) -> tuple[Body, ...]:
        """Driven bodies that carry no other driven one."""
        parent = {body.name: body.parent for body in self.bodies}
        carriers, rest = set[str](), [body.parent for body in self.driven]
        while rest:
            above = rest.pop()
            if above is not None and above not in carriers:
                carriers.add(above)
                rest.append(parent.get(above))
        return tuple(body for body in self.driven if body.name not in carriers)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the driven joints in spec order."""
        return tuple(b.joint.name for b in self.driven)


@dataclass(frozen=True, kw_only=True)
class Stick:
    """The manipulated object; its long axis is z in its own frame, origin at its centre."""

    name: str
    shape: str
    """'capsule' (round, round ends) or 'box' (square section)."""
    length_m: float
    """Distance between the two tips [m]."""
    radius_m: float
    """Radius of a round stick, half the side of a square one [m]."""
    mass_kg: float
    friction: float
    """Coefficient of friction between this stick and a fingertip."""
    grip_to_lower_end_m: float = 0.13
    """Height of the pinched point above the lower end [m]."""

    @property
    def inertia_kgm2(self) -> Vec3:
        """Principal inertias [kg m^2] of the solid body: a cylinder, or a square bar."""
        m, length, r = self.mass_kg, self.length_m, self.radius_m
        if self.shape == "box":
            across = m * ((2 * r) ** 2 + length**2) / 12
            return (across, across, m * (2 * r) ** 2 / 6)
        across = m * (3 * r**2 + length**2) / 12
        return (across, across, m * r**2 / 2)


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Properties of every fingertip contact, besides the stick's own friction."""

    torsion_radius_m: float
    """Radius of spin friction: its torque over normal force and friction coefficient [m]."""
    time_constant_s: float
    """Time constant in which a penetration relaxes, in engines with soft contacts [s]."""
    compliance_m_n: float = 0.0
    """Compliance of a contact on top of the engine's own [m/N]; 0: the nominal surfaces."""
    creep_m_ns: float = 0.0
    """Speed at which a contact creeps under a force along its surface, per unit of it, on top of
    the engine's own [m/(N s)]."""
    spin_radius_m: float = 0.0
    """Radius of spin friction on top of the engine's own [m]; negative: less, at least none."""
    touch_n: float = 0.0
    """Normal force that a fingertip's contact has to exceed to be read as touch [N]."""

    @property
    def spin_m(self) -> float:
        """Radius of spin friction in an engine that takes `torsion_radius_m` as it is [m]."""
        return max(self.torsion_radius_m + self.spin_radius_m, 0.0)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Rates and the settling time at the start of an episode."""

    drive_s: float = 1e-3
    """Period of drive and physics [s]."""
    policy_s: float = 20e-3
    """Period of the policy [s]."""
    weightless_s: float = 0.1
    """Time after a reset during which the stick's weight is compensated [s]."""

    @property
    def substeps(self) -> int:
        """Drive periods in one policy period."""
        return round(self.policy_s / self.drive_s)


@dataclass(frozen=True, kw_only=True)
class Spec:
    """One complete simulated world: everything that an engine needs to build it."""

    hand: Hand
    """What is driven: bodies, joints, drives and fingertips."""
    stick: Stick
    """What is held."""
    contact: Contact
    """Spin friction and softness of the fingertip contacts."""
    timing: Timing
    """Periods of drive and policy, and the settling time of an episode."""
    gravity_m_s2: Vec3 = (0.0, 0.0, -9.81)
    """Gravity [m/s2], world frame."""

    @cached_property
    def digest(self) -> str:
        """First 12 hex digits of the SHA-256 of all numbers; equal digests mean equal worlds."""
        text = json.dumps(_numbers(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Drives of the driven joints in spec order."""
        return tuple(b.joint.drive for b in self.hand.driven if b.joint.drive is not None)

    def with_driven(self, driven: Iterable[Body]) -> "Spec":
        """This world with other driven bodies, given in spec order."""
        fresh = iter(driven)
        bodies = tuple(b if b.joint.drive is None else next(fresh) for b in self.hand.bodies)
        return dataclasses.replace(self, hand=dataclasses.replace(self.hand, bodies=bodies))

    def with_drives(self, drives: Iterable[Drive]) -> "Spec":
        """This world with other drives, one per driven joint in spec order."""
        pairs = zip(self.hand.driven, drives, strict=True)
        return self.with_driven(
            dataclasses.replace(b, joint=dataclasses.replace(b.joint, drive=d)) for b, d in pairs
        )

    def values(self, number: str) -> tuple:
        """All values of a number such as 'drive.kp_nm_rad' in this world, see `field_names`."""
        part, field = number.split(".")
        joints = [body.joint for body in self.hand.bodies]
        homes: dict[str, Iterable[Any]] = {
            "body": self.hand.bodies,
            "joint": joints,
            "fingertip": self.hand.fingertips,
            "taxels": (self.hand.taxels,),
            "spec": (self,),
        }
        if part in ("drive", "command", "encoder", "loop"):
            found: Iterable[Any] = [getattr(j, part) for j in joints if j.drive is not None]
        else:
            found = homes[part] if part in homes else (getattr(self, part),)
        return tuple(getattr(item, field) for item in found)


def _numbers(part: Any) -> Any:
    """A spec as plain data, without numbers that are zero by default and are zero.

    So a number that is added for a new effect does not change the digest of other worlds.
    """
    if isinstance(part, tuple):
        return [_numbers(item) for item in part]
    if not dataclasses.is_dataclass(part):
        return part
    kept = {}
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        plain = _numbers(value)
        if not (plain == {} or (value == field.default and value in _ZEROS)):
            kept[field.name] = plain
    return kept


def field_names() -> tuple[str, ...]:
    """Names of all numbers of a spec, such as 'drive.kp_nm_rad'; each has an entry in `support`."""
    parts = (
        Drive,
        Command,
        Loop,
        Encoder,
        Joint,
        Body,
        Fingertip,
        Taxels,
        Hand,
        Stick,
        Contact,
        Timing,
    )
    nested = {"bodies", "fingertips", "taxels", "joint", "drive", "command", "encoder"}
    nested |= {"loop", "name", "finger"}
    names = [
        f"{part.__name__.lower()}.{f.name}"
        for part in parts
        for f in dataclasses.fields(part)
        if f.name not in nested
    ]
    return (*names, "spec.gravity_m_s2")
