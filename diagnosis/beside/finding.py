"""What diagnoses beside the replayed ones find: random effects, touch, stick and contact."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.rules import confidence, rules
from diagnosis.attribution.verdict import UNKNOWN

SENSING, PUSH, TOUCH, STICK = "sensing", "push", "touch", "stick"
ALIKE = 0.1
"""Magnitudes of joints are one where their intervals meet or they differ by less, relative."""
_GAPS = ("gap_before", "gap_after")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An effect that was found, or a gap that is `unknown`."""

    effect: str
    """Name of an effect, or `unknown`."""
    joint: str | None
    """None: every joint that the effect concerns, or an effect that concerns none."""
    value: float
    """Magnitude in SI units, 0 of an unknown."""
    interval: tuple[float, float]
    """90 % interval of the magnitude."""
    joints: tuple[str, ...] = ()
    """Joints that it was found on."""
    share: float
    """Share of the squared gap above the floor that it explains."""
    gap_before: float
    """Root mean square of what it was judged by, over the floor, as nominal."""
    gap_after: float
    """The same with the effect."""
    lead_nats: float
    """How far it is ahead of the next best explanation."""
    ties: tuple[tuple[str, float], ...] = ()
    """Effects that this log cannot distinguish from it, and their log evidence ratios [nats]."""
    experiment: str = "record --protocol grasp with more --variants"
    """What would tell them from it."""
    instead: bool = False
    """Whether it takes the place of what replays found on its joints, or stands beside it."""
    evidence: str
    """What in the log says so."""
    family: str = SENSING
    """What it is wrong with: `sensing`, `touch` or `stick`; `push`: a joint that was pushed."""

    @property
    def confidence(self) -> float:
        """Probability that it is right."""
        right = rules().right
        if self.effect == UNKNOWN:
            return right.unknown
        share = right.grasp if self.family in (TOUCH, STICK) else right.effect
        return confidence(share, [nats for _, nats in self.ties] or [self.lead_nats])


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


def gap(residual: Array, sigma: Array | float) -> float:
    """Root mean square of residuals over their standard deviation."""
    return float(np.sqrt(np.mean((residual / sigma) ** 2)))


def share(before: float, after: float) -> float:
    """Share of the squared gap above the floor that is gone."""
    excess = before**2 - 1.0
    return float(np.clip(1 - max(after**2 - 1.0, 0.0) / excess, 0.0, 1.0)) if excess > 0 else 0.0


def together(found: Sequence[Finding], concerned: Sequence[str]) -> tuple[Finding, ...]:
    """One effect that every joint concerned agrees on is one finding without a joint."""
    joints = [name for one in found for name in one.joints]
    if len(found) < 2 or sorted(joints) != sorted(concerned):
        return tuple(found)
    value, low, high = np.median([(f.value, *f.interval) for f in found], axis=0)
    apart = any(f.interval[0] > high or f.interval[1] < low for f in found)
    if apart and any(abs(f.value - value) > ALIKE * value for f in found):
        return tuple(found)
    gaps = [float(np.sqrt(np.mean([getattr(f, k) ** 2 for f in found]))) for k in _GAPS]
    one = max(found, key=lambda f: f.lead_nats)
    return (
        replace(
            one,
            joint=None,
            joints=tuple(concerned),
            value=float(value),
            interval=(float(low), float(high)),
            gap_before=gaps[0],
            gap_after=gaps[1],
            share=share(*gaps),
            evidence=f"on every joint: {one.evidence}",
        ),
    )
