"""Findings about sensors, packets and joints that were pushed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from diagnosis.attribution.rules import confidence, rules
from diagnosis.finding import UNKNOWN, share
from diagnosis.finding import Finding as Beside

SENSING, PUSH = "sensing", "push"
ALIKE = 0.1
"""Magnitudes of joints are one where their intervals meet or they differ by less, relative."""
_GAPS = ("gap_before", "gap_after")


@dataclass(frozen=True, kw_only=True)
class Finding(Beside):
    """A finding that may take the place of a limb's verdict."""

    instead: bool = False
    """Whether it takes the place of what replays found on its joints, or stands beside it."""
    family: str = SENSING

    @property
    def confidence(self) -> float:
        """Probability that it is right."""
        right = rules().right
        if self.effect == UNKNOWN:
            return right.unknown
        return confidence(right.effect, [nats for _, nats in self.ties] or [self.lead_nats])


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
