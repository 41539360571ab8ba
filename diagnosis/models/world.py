"""A limb with parameters at given sizes: from coordinates u to what its sensors show."""

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.models.parameters import Parameter
from diagnosis.motion import columns as c
from diagnosis.motion.along import AXES
from diagnosis.replay.dynamics import link_inertia

FIRM = 0.4
"""A gear that a rigid drive gets is at most so stiff: k dt^2 over the inertia that it sees."""
RATIO, FIRM_RATIO = 0.15, 0.6
"""Damping ratio of such a gear, and of one that is as stiff as it may be."""
REMEMBERED = 32
"""So many of the last replays are remembered: fits come back to where they were."""
POSITIVE = (c.COULOMB, c.VISCOUS, c.PLAY)
"""Numbers that tolerances may not take below zero."""


class World:
    """What a limb shows with its parameters at u."""

    def __init__(self, evidence: Evidence, parameters: Sequence[Parameter] = ()) -> None:
        self.evidence, self.parameters = evidence, tuple(parameters)
        self._remembered = lru_cache(REMEMBERED)(self._shown)

    def shown(self, u: Mapping[int, float], nudge: float = 0.0) -> Array:
        """What the sensors show with parameters (by number) at u, as `Evidence.readings` (M,).

        `nudge`: a shift of all starts [rad; of a slide a share of its travel].
        """
        return self._remembered(frozenset((k, v) for k, v in u.items() if v), nudge)

    def _shown(self, u: frozenset[tuple[int, float]], nudge: float) -> Array:
        shown = self.evidence.pack(self.blocks(dict(sorted(u)), nudge))
        own = sum(x for k, x in u if self.parameters[k].place == c.OWN_STEPS)
        return shown + own * self.evidence.own_steps if own else shown

    def blocks(self, u: Mapping[int, float], nudge: float = 0.0) -> Array:
        """What the sensors show, as block means (N, 3, K)."""
        shift = nudge * self.evidence.size
        return self.evidence.limb.simulate(*self.numbers(u), shift)

    def numbers(self, u: Mapping[int, float]) -> tuple[Array, Array]:
        """The joints' numbers (K, len(COLUMNS)) and gravity's tilt (2,) [rad]."""
        limb = self.evidence.limb
        numbers, tilt = limb.nominal.copy(), np.zeros(len(AXES))
        soft = np.zeros(len(limb.joints))
        for number, value in u.items():
            one = self.parameters[number]
            if not value or one.place == c.OWN_STEPS:
                continue
            if one.is_tilt:
                tilt[one.place] += value
                continue
            rows = slice(None) if one.joint is None else one.joint
            for place, seen in one.beside:
                numbers[rows, place] = seen
            if one.kind.coordinate == "logarithm":
                numbers[rows, one.place] *= np.exp(value)
            elif one.kind.coordinate == "compliance":
                soft[rows] += value * one.unit
            else:
                own = one.joint is None and one.kind.dimension == "torque"
                unit = self.evidence.torque if own else one.unit
                numbers[rows, one.place] += one.onset + value * unit
        known, mass = limb.nominal[:, c.MASS], numbers[:, c.MASS]
        numbers[:, c.CARRIED] *= np.divide(known, mass, out=np.ones_like(mass), where=mass > 0.0)
        numbers[:, POSITIVE] = np.maximum(numbers[:, POSITIVE], 0.0)
        self._with_gears(numbers, soft)
        return numbers, tilt

    def _with_gears(self, numbers: Array, soft: Array) -> None:
        """Make gears more compliant by `soft` (K,) [rad/Nm]; rigid drives with play get one."""
        limb = self.evidence.limb
        if not limb.rigid:
            numbers[:, c.STIFFNESS] = 1.0 / (1.0 / numbers[:, c.STIFFNESS] + soft)
            return
        for j in np.flatnonzero((soft > 0.0) | (numbers[:, c.PLAY] > 0.0)):
            most = FIRM * self._reduced[j] / limb.dt**2
            stiffness = min(1.0 / max(soft[j], 1e-12), most)
            ratio = FIRM_RATIO if stiffness == most else RATIO
            numbers[j, c.TWO_MASSES], numbers[j, c.STIFFNESS] = 1.0, stiffness
            numbers[j, c.TEETH] = 2.0 * ratio * np.sqrt(stiffness * self._reduced[j])

    @cached_property
    def _reduced(self) -> Array:
        """Inertia that a gear's spring sees between rotor and link [kg m^2], shape (K,)."""
        limb = self.evidence.limb
        link = link_inertia(np.concatenate([one.model[0] for one in limb.along])[::50])
        rotor = limb.nominal[:, c.ROTOR]
        return link * rotor / (link + rotor)
