"""Hands in free air on an engine that is no backend: one world each, with its own drive rate.

There is no stick, and nothing touches. If the torque of a tooth's spring k is held for a period dt
while the link moves on, k dt / 2 of the damping of the teeth is lost; at 1 ms a third of it. So the
drives of engines that integrate exactly run faster than the 1 kHz of backends.
"""

import dataclasses
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Protocol

from backends.engine import EXACT, SHARED_SUPPORT, Engine
from backends.spec import Spec, field_names
from backends.state import Array, InitialState

CARRIED = ("body", "fingertip", "spec")
"""Groups of spec fields that a free hand uses."""
_BARE = "approximate: there is no stick and no contact"


class World(Protocol):
    """One hand of an engine."""

    def place(self, joint_rad: Array) -> None:
        """Put the hand at rest."""

    def step(self, torque_nm: Array, ticks: int) -> tuple[Array, Array]:
        """Joint angles [rad] and speeds [rad/s] after so many drive periods."""


class FreeHands(Engine):
    """N hands in free air; a subclass named `Backend` in its own file is one engine."""

    support = {
        **dict.fromkeys(field_names(), _BARE),
        **{name: EXACT for name in field_names() if name.split(".")[0] in CARRIED},
        **SHARED_SUPPORT,
        "joint.axis": EXACT,
        "joint.slides": "refused: only hinge joints are built",
    }
    drive_s: ClassVar[float]
    """Period of the drives [s]."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        super().__init__([self._at_own_rate(spec) for spec in specs])
        self._worlds = [self._world(spec) for spec in self.specs]

    @classmethod
    def _at_own_rate(cls, spec: Spec) -> Spec:
        timing = dataclasses.replace(spec.timing, drive_s=cls.drive_s)
        return dataclasses.replace(spec, timing=timing)

    @abstractmethod
    def _world(self, spec: Spec) -> World:
        """Build one hand."""

    def close(self) -> None:
        """Free the worlds."""
        self._worlds = []

    def _place(self, ids: Array, initial: InitialState) -> None:
        for n in ids:
            self._worlds[n].place(initial.joint_rad[n])

    def _tick(
        self, rows: slice, torque_nm: Array, stick_force_n: Array | None, ticks: int = 1
    ) -> None:
        angle, speed = self.state.joint_rad[rows], self.state.joint_rad_s[rows]
        for n, world in enumerate(self._worlds[rows]):
            angle[n], speed[n] = world.step(torque_nm[n], ticks)

    def _observe(self, rows: slice) -> None:
        """The stick floats and stays where it was placed."""
