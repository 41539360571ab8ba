"""A plant with geared limbs in Python: one robot, and the numbers of its laws per joint.

A subclass of `Geared` named `Mechanics` in its own file is one plant. It defines its baseline and
its laws of servo and friction (see `_two_mass`), and the numbers that these need.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self

import numba
import numpy as np

from backends.state import Array
from diagnosis.blind import plant
from diagnosis.blind.mechanics import _two_mass
from diagnosis.blind.plant import Course, Limb

PERIOD_S = 1e-3


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The small faults that every robot of a plant has; defaults are those of a typical one."""

    stiffness_kp: float = 100.0
    """Stiffness of its gears over kp, where the data sheet has them stiffer."""
    friction_share: float = 1e-3
    """Dry friction over the torque limit, in addition to the data sheet."""
    bend_rad: float = 4e-4
    """Angle over which dry friction builds up after a reversal."""

    ranges: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Range of a number over robots, by name of its field."""

    @classmethod
    def individual(cls, rng: np.random.Generator) -> Self:
        """One robot of the plant: its numbers are uniform in their ranges."""
        ends = {"stiffness_kp": (60.0, 150.0), **cls.ranges}
        names = [f.name for f in fields(cls) if f.name in ends]
        return replace(cls(), **{name: float(rng.uniform(*ends[name])) for name in names})


@numba.njit(_two_mass.SERVO, cache=True)
def pd(target, motor, speed, first, drive, own, state):
    """PD on the encoder and its difference, once in `PERIOD_S`."""
    felt = _two_mass.read_speed(motor, PERIOD_S, 0.0, first, state)
    asked = drive[0] * _two_mass.banded(target - motor, drive[12]) - drive[1] * felt
    return min(max(asked, -drive[2]), drive[2])


@numba.njit(_two_mass.FRICTION, cache=True)
def one_bristle(speed, own, state):
    """Dahl's friction; its bend is the first of a plant's own numbers."""
    state[6] = _two_mass.bristle(speed, own[0], state[6])
    return state[6]


class Geared(plant.Mechanics):
    """Limbs of one or two parallel hinges, each with a servo and a gear; see the protocol."""

    tick_s: float = _two_mass.TICK_S
    baseline: ClassVar[type[Baseline]]
    laws: ClassVar[tuple[Callable, Callable]]
    """Compiled functions of servo and friction."""

    def __init__(self, baseline: Any = None) -> None:
        self._base = baseline or self.baseline()

    @classmethod
    def individual(cls, rng: np.random.Generator) -> Self:
        """One robot of this plant."""
        return cls(cls.baseline.individual(rng))

    def __call__(self, limb: Limb, wanted_rad: Array, push_nm: Array) -> Course:
        """The motion from rest at `wanted_rad[0]`."""
        limit_nm = np.array([b.joint.drive.torque_limit_nm for b in limb.bodies if b.joint.drive])
        numbers = dict(limb.numbers)
        numbers["coulomb"] = numbers["coulomb"] + self._base.friction_share * limit_nm
        numbers["stiction"] = numbers["stiction"] + self.stiction(self._base, numbers)
        chassis = self.chassis(self._base, limit_nm)
        stiffness = self._base.stiffness_kp * numbers["kp"]
        own = self.own(self._base, limit_nm)
        return _two_mass.run(
            self.laws,
            replace(chassis, stiffness_nm_rad=stiffness),
            np.array([np.broadcast_to(row, len(limit_nm)) for row in own], dtype=float),
            replace(limb, numbers=numbers),
            wanted_rad,
            push_nm,
        )

    def stiction(self, base: Any, numbers: Mapping[str, Array]) -> Array | float:
        """Stiction that every robot has [Nm]."""
        return 0.0

    def chassis(self, base: Any, limit_nm: Array) -> _two_mass.Chassis:
        """Numbers that all plants have; `limit_nm` are the torque limits of the data sheet."""
        raise NotImplementedError

    def own(self, base: Any, limit_nm: Array) -> list:
        """Numbers of the plant's laws, one for all joints or one per joint."""
        raise NotImplementedError
