"""What is found beside a verdict on joints: touch, stick and contact."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array

UNKNOWN = "unknown"
TOUCH, STICK = "touch", "stick"
RIGHT, RIGHT_UNKNOWN = 0.88, 0.90
"""Shares of effects named on touch, stick and contact, and of gaps called `unknown` there, that
were right where the blind check hid them in grasps."""
Z90 = 1.645
"""Half of a 90 % interval, in standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An effect that was found, or a gap that is `unknown`.

    It stands beside the verdict on joints, and neither lends it its confidence nor changes it.
    """

    effect: str
    """Name of an effect, or `unknown`."""
    value: float = 0.0
    """Magnitude in SI units, 0 of an unknown."""
    interval: tuple[float, float] = (0.0, 0.0)
    """90 % interval of the magnitude."""
    share: float
    """Share of the squared gap above the floor that it explains."""
    gap_before: float
    """Root mean square of what it was judged by, over the floor, as nominal."""
    gap_after: float
    """The same with the effect."""
    ties: tuple[str, ...] = ()
    """Effects that this log cannot distinguish from it."""
    evidence: str
    """What in the log says so."""
    family: str
    """What it is wrong with: `touch` or `stick`."""

    @property
    def confidence(self) -> float:
        """Probability that it is right: shared with what is tied."""
        return RIGHT_UNKNOWN if self.effect == UNKNOWN else RIGHT / (1 + len(self.ties))


@dataclass(frozen=True, kw_only=True)
class Spot:
    """What touch or stick show at one finger, root mean squares over the floor."""

    finger: str
    family: str
    """`touch` or `stick`."""
    gap_before: float
    gap_after: float


@dataclass(frozen=True, kw_only=True)
class Report:
    """Findings, where they show, and what a log does not tell."""

    findings: tuple[Finding, ...] = ()
    spots: tuple[Spot, ...] = ()
    missing: tuple[str, ...] = ()
    """Why effects could not be looked for, and what to record for them."""
    world: Spec | None = None
    """The nominal world with the shapes that were found, named or not; None: as it was."""

    def __add__(self, other: "Report") -> "Report":
        """Both, in this order; the world is the later one."""
        return Report(
            findings=(*self.findings, *other.findings),
            spots=(*self.spots, *other.spots),
            missing=(*self.missing, *other.missing),
            world=other.world or self.world,
        )


def missing(names: Iterable[str], why: str) -> tuple[str, ...]:
    """What to say of effects that could not be looked for; nothing of none."""
    said = ", ".join(names)
    return (f"{said}: {why}",) if said else ()


def gap(residual: Array, sigma: Array | float) -> float:
    """Root mean square of residuals over their standard deviation."""
    return float(np.sqrt(np.mean((residual / sigma) ** 2)))


def share(before: float, after: float) -> float:
    """Share of the squared gap above the floor that is gone."""
    excess = before**2 - 1.0
    return float(np.clip(1 - max(after**2 - 1.0, 0.0) / excess, 0.0, 1.0)) if excess > 0 else 0.0
