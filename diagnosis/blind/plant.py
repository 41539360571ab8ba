"""A plant: a real mechanism with other equations than engines and solver, and its effects.

It shares no code with them. The meaning of every effect is implemented here again, and the
equations of motion are in `mechanics`, one file per plant. Besides the effects, a plant always has
small faults that every real drive has; the hidden effects of a case dominate them.

A file of `mechanics` holds one class named `Mechanics`, whose interface is defined below.
"""

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numba
import numpy as np

from backends.spec import Body, Spec, Vec3
from backends.state import Array

DRIVE = (
    *("kp", "kd", "limit", "rotor", "coulomb", "viscous", "stiffness", "damping", "play"),
    *("lock", "stiction", "load", "dead", "uneven", "emf", "cogging", "stop", "lower", "upper"),
    "fade",
)
"""Numbers of a drive, in the order in which equations take them.

`uneven`: dry friction where the motor turns upwards, if positive, else where it turns downwards;
`emf`: torque that a motor's limit loses per speed; `cogging`: amplitude of a torque that goes as
sin(18 motor angle); `stop`: how far inside of the upper end of its range, if positive, else of the
lower one, the link meets an elastic stop; `lower` and `upper`: those ends; `fade`: share of its
torque that a motor loses at the heat of lasting torque at its limit.
"""
_OTHER = (
    *("delay", "slowness", "loss", "step"),
    *("mass", "held", "carried", "bias", "scale", "once", "quarter", "resolution", "noise", "late"),
    "slip",
)
NUMBERS = (*DRIVE, *_OTHER)
CHANGES = {
    "backlash": ("play", "add"),
    "self-lock": ("lock", "add"),
    "coulomb-friction": ("coulomb", "add"),
    "direction-friction": ("uneven", "add"),
    "cogging": ("cogging", "add"),
    "end-stop": ("stop", "add"),
    "gravity-compensation": ("carried", "add"),
    "stiction": ("stiction", "add"),
    "viscous-friction": ("viscous", "add"),
    "load-friction": ("load", "add"),
    "series-elasticity": ("stiffness", "divide"),
    "rotor-inertia": ("rotor", "add"),
    "link-mass": ("mass", "scale"),
    "payload": ("held", "add"),
    "kp-scale": ("kp", "scale"),
    "kd-scale": ("kd", "scale"),
    "gear-damping": ("damping", "scale"),
    "torque-limit": ("limit", "scale"),
    "torque-speed-limit": ("emf", "add"),
    "thermal-fade": ("fade", "add"),
    "command-delay": ("delay", "add"),
    "command-rate-limit": ("slowness", "add"),
    "command-dropout": ("loss", "add"),
    "command-resolution": ("step", "add"),
    "dead-zone": ("dead", "add"),
    "encoder-bias": ("bias", "add"),
    "encoder-scale": ("scale", "add"),
    "encoder-eccentricity": ("once", "add"),
    "encoder-eccentricity-sine": ("quarter", "add"),
    "encoder-resolution": ("resolution", "add"),
    "encoder-noise": ("noise", "add"),
    "sensor-delay": ("late", "add"),
}
"""How each effect changes NUMBERS; a tilt of gravity is separate."""
TILT = "gravity-tilt"
IMPLEMENTED = (*CHANGES, TILT)
"""Effects that plants have: each is implemented here again."""
MAGNET_SLIP = "magnet-slip"
"""The fault that no catalogue has: an encoder's magnet slips, for good, halfway through a log."""
WORMS = ("backlash", "self-lock")
"""Effects that concern worm gears alone, unless a joint is named."""


@dataclass(frozen=True, kw_only=True)
class Limb:
    """A chain of driven hinges from the palm outwards, with the effects."""

    bodies: tuple[Body, ...]
    """Their drives are the nominal ones; `numbers` override them."""
    numbers: Mapping[str, Array]
    """By name of NUMBERS, shape (joints,)."""
    gravity_m_s2: Array


Course = tuple[Array, Array, Array]
"""Angles at every tick; motor angles and motor torques at every sample; all (.., joints)."""


class Mechanics(ABC):
    """Equations of motion of one limb: the drive law of a plant with its own small faults.

    `Mechanics()` is a typical robot. It may read the limb's `numbers` by name. Errors of commands
    and readings are applied by `Plant`. The same call gives the same motion.
    """

    tick_s: float
    """Its period [s]; a sample is a whole number of them."""

    @classmethod
    def individual(cls, rng: np.random.Generator) -> Self:
        """One robot of this kind; all are alike where it draws no numbers of its own."""
        return cls()

    @abstractmethod
    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """The motion from rest at `wanted_rad[0]`; raises ValueError for unsupported limbs.

        `wanted_rad` are the targets of the drives at every tick; `push_nm` are external torques
        from every sample on.
        """


class Plant:
    """One real mechanism: the numbers of a rig, changed by effects."""

    def __init__(self, spec: Spec, mechanics: Mechanics) -> None:
        self._mechanics = mechanics
        self._driven = spec.hand.driven
        self._limbs = _limbs(spec)
        self._gravity = np.array(spec.gravity_m_s2)
        self.numbers = {name: np.zeros(len(self._driven)) for name in NUMBERS}
        for j, body in enumerate(self._driven):
            drive = body.joint.drive
            assert drive is not None
            known = {
                "kp": drive.kp_nm_rad,
                "kd": drive.kd_nms_rad,
                "limit": drive.torque_limit_nm,
                "rotor": drive.rotor_inertia_kgm2,
                "coulomb": drive.coulomb_nm,
                "viscous": drive.viscous_nms_rad,
                "stiffness": drive.gear_stiffness_nm_rad,
                "damping": drive.gear_damping_nms_rad,
                "play": drive.play_rad,
                "mass": body.mass_kg,
                "noise": body.joint.encoder.noise_rad,
                "lower": body.joint.range_rad[0],
                "upper": body.joint.range_rad[1],
            }
            for name, value in known.items():
                self.numbers[name][j] = value

    def add(self, effect: str, magnitude: float, joint: str | None) -> None:
        """Add an effect, or MAGNET_SLIP [rad], by name, on one joint or on all it concerns.

        Its magnitude is in SI units.
        """
        if effect == TILT:
            size, (c, s) = self._gravity[2], (np.cos(magnitude), np.sin(magnitude))
            self._gravity = np.array([-s * size, 0.0, c * size])
            return
        number, how = (CHANGES | {MAGNET_SLIP: ("slip", "add")})[effect]
        for j, body in enumerate(self._driven):
            wanted = body.joint.gear == "worm" if effect in WORMS else True
            if joint == body.joint.name or (joint is None and wanted):
                value = self.numbers[number][j]
                self.numbers[number][j] = {
                    "add": value + magnitude,
                    "scale": value * (1 + magnitude),
                    "divide": value / (1 + magnitude),
                }[how]

    def run(
        self,
        target_rad: Array,
        push_nm: Array,
        sample_s: float,
        rng: np.random.Generator,
        slipped: bool = False,
    ) -> dict[str, Array]:
        """The readings of one episode of T samples from rest: position, motor, torque, (T, J).

        `slipped`: the episode lies in the second half of its log, after a magnet has slipped.
        """
        wanted = self._wanted(self._kept(target_rad, rng), sample_s)
        angle = np.zeros(wanted.shape)
        motor, torque = np.zeros(target_rad.shape), np.zeros(target_rad.shape)
        for columns in self._limbs:
            angle[:, columns], motor[:, columns], torque[:, columns] = self._mechanics(
                self._limb(columns), wanted[:, columns], push_nm[:, columns]
            )
        position = self._read(angle, sample_s * np.arange(len(target_rad)), rng, slipped)
        return {"position": position, "motor": motor, "torque": torque}

    def _limb(self, columns: list[int]) -> Limb:
        loads = np.stack([self.numbers[name] for name in ("mass", "held", "carried")], axis=1)
        bodies = (_holding(self._driven[j], *map(float, loads[j])) for j in columns)
        return Limb(
            bodies=tuple(bodies),
            numbers={name: self.numbers[name][columns] for name in DRIVE},
            gravity_m_s2=self._gravity,
        )

    def _kept(self, target_rad: Array, rng: np.random.Generator) -> Array:
        """Targets in steps, with packets lost: all joints share one packet per sample."""
        kept, draws = target_rad.copy(), rng.uniform(size=len(target_rad))
        for j in np.flatnonzero(self.numbers["step"]):
            step = self.numbers["step"][j]
            kept[:, j] = np.floor(kept[:, j] / step + 0.5) * step
        for k in range(1, len(kept)):
            lost = draws[k] < self.numbers["loss"]
            kept[k, lost] = kept[k - 1, lost]
        return kept

    def _wanted(self, sent_rad: Array, sample_s: float) -> Array:
        """What drives follow at every tick: targets as they were, no faster than they may move."""
        tick_s = self._mechanics.tick_s
        steps = round(sample_s / tick_s)
        ticks = np.arange((len(sent_rad) - 1) * steps + 1)
        now_s = ticks // steps * sample_s + ticks % steps * tick_s
        wanted = np.zeros((len(ticks), sent_rad.shape[1]))
        for j in range(wanted.shape[1]):
            rows = np.floor((now_s - self.numbers["delay"][j]) / sample_s + 1e-6).astype(int)
            wanted[:, j] = sent_rad[np.maximum(rows, 0), j]
            if self.numbers["slowness"][j] > 0.0:
                _follow(wanted[:, j], tick_s / self.numbers["slowness"][j])
        return wanted

    def _read(self, angle: Array, times_s: Array, rng: np.random.Generator, slipped: bool) -> Array:
        """Readings of the position sensors at the samples from the angles at every tick."""
        ticks_s = self._mechanics.tick_s * np.arange(len(angle))
        numbers = self.numbers
        columns = []
        for j in range(angle.shape[1]):
            then = np.interp(times_s - numbers["late"][j], ticks_s, angle[:, j])
            read = then + numbers["scale"][j] * then + numbers["bias"][j]
            read += numbers["once"][j] * np.cos(then) + numbers["quarter"][j] * np.sin(then)
            read += numbers["noise"][j] * rng.normal(size=len(read)) + numbers["slip"][j] * slipped
            step = numbers["resolution"][j]
            columns.append(np.floor(read / step + 0.5) * step if step > 0 else read)
        return np.stack(columns, axis=1)


@numba.njit(cache=True)
def _follow(wanted_rad, most_rad):
    """Move targets in place, no further than so much from one to the next."""
    for k in range(1, len(wanted_rad)):
        move = wanted_rad[k] - wanted_rad[k - 1]
        wanted_rad[k] = wanted_rad[k - 1] + min(max(move, -most_rad), most_rad)


def _holding(body: Body, mass_kg: float, share: float, carried: float) -> Body:
    """A link of this mass and a point on it, of so much of it, as one rigid body.

    `carried`: the share of the link's own weight that is.
    """
    own, point = np.array(body.com_m), np.array(body.payload_m)
    center = (own + share * point) / (1.0 + share)
    (x, y, z), (xy, xz, yz) = body.inertia_kgm2, body.products_kgm2
    tensor = np.array([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
    for part_kg, at in ((mass_kg, own - center), (share * mass_kg, point - center)):
        tensor += part_kg * (at @ at * np.eye(3) - np.outer(at, at))
    return dataclasses.replace(
        body,
        mass_kg=(1.0 + share) * mass_kg,
        carried=carried / (1.0 + share),
        com_m=_triple(center),
        inertia_kgm2=_triple(np.diag(tensor)),
        products_kgm2=_triple(tensor[[0, 0, 1], [1, 2, 2]]),
    )


def _triple(numbers: Array) -> Vec3:
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


def _limbs(spec: Spec) -> list[list[int]]:
    """Columns of the joints of each limb, from the palm outwards; ValueError where one branches."""
    driven: Sequence[Body] = spec.hand.driven
    limbs: dict[str, list[int]] = {}
    for j, body in enumerate(driven):
        carrier = body.parent or ""
        if carrier not in limbs and carrier in [b.name for b in driven]:
            raise ValueError("a plant supports only limbs that do not branch")
        limbs[body.name] = [*limbs.pop(carrier, []), j]
    return list(limbs.values())
