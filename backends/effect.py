"""Effects: what reality adds to the ideal hand, each a magnitude with a unit and maybe a joint."""

import dataclasses
from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

from backends.spec import Drive, Spec

UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", 0.017453292519943295),
    "Nm": ("torque", 1.0),
    "mNm": ("torque", 1e-3),
    "Nms": ("damping", 1.0),
    "mNms": ("damping", 1e-3),
    "%": ("share", 0.01),
    "kgm2": ("inertia", 1.0),
    "gcm2": ("inertia", 1e-7),
}
"""Units on the command line: their dimension and their size in SI."""


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Base of every effect; a subclass named `Effect` in its own file is one effect.

    Zero magnitude is the identity. Effects compose by being applied one after the other.
    """

    magnitude: float
    """Size in SI units of `dimension`."""
    joint: str | None = None
    """The one joint it acts on; None: every joint it applies to."""

    dimension: ClassVar[str]
    """Dimension of the magnitude: a value of `UNITS`."""
    unit: ClassVar[str]
    """Unit in which it is usually written."""
    bounds: ClassVar[tuple[float, float]]
    """Allowed magnitudes in SI units, both included."""
    per_joint: ClassVar[bool] = True
    """Whether it acts on joints, and so may name one."""

    @classmethod
    def spec_fields(cls) -> tuple[str, ...]:
        """Names of the spec's numbers that change: an engine takes the effect as it takes these."""
        return ()

    def on_spec(self, spec: Spec) -> Spec:
        """The world with this effect; raises ValueError where the effect cannot act."""
        return spec


class DriveEffect(Effect):
    """Base of the effects that change one number of a joint's drive."""

    field: ClassVar[str]
    """The number of `Drive` that changes."""
    relative: ClassVar[bool] = False
    """The magnitude is a share of that number instead of an amount."""
    gear: ClassVar[str | None] = None
    """Without a named joint, only joints with this gear are concerned; None: all are."""

    @classmethod
    def spec_fields(cls) -> tuple[str, ...]:
        """See `Effect.spec_fields`."""
        return (f"drive.{cls.field}",)

    def on_spec(self, spec: Spec) -> Spec:
        """See `Effect.on_spec`."""
        if self.joint is not None and self.joint not in spec.hand.joint_names:
            known = ", ".join(spec.hand.joint_names)
            raise ValueError(f"no driven joint named '{self.joint}'; known: {known}")
        drives = list(spec.drives)
        for j, body in enumerate(spec.hand.driven):
            fits = self.gear is None or body.joint.gear == self.gear
            if body.joint.name == self.joint or (self.joint is None and fits):
                drives[j] = self._changed(drives[j])
        return spec.with_drives(tuple(drives))

    def _changed(self, drive: Drive) -> Drive:
        value = getattr(drive, self.field)
        value = value * (1 + self.magnitude) if self.relative else value + self.magnitude
        return dataclasses.replace(drive, **{self.field: value})
