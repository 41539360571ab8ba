"""What was found: fitted effects with their magnitudes, and one finding where limbs agree."""

from dataclasses import dataclass

import numpy as np

from backends.effect import UNITS, Effect
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.intervals import intervals, settled
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import LimbVerdict

UNBOUND = 20.0
"""Ends of an interval that are further apart, as a ratio, say next to nothing."""


@dataclass(frozen=True, kw_only=True)
class Magnitude:
    """A fitted effect."""

    effect: str
    joint: str | None
    """None: every joint that the effect concerns."""
    value: float
    """In `unit`."""
    unit: str
    interval: tuple[float, float]
    """90 % interval in `unit`."""
    joints: tuple[str, ...] = ()
    """Joints that it was found on."""

    @property
    def loose(self) -> bool:
        """Whether the log does not bound it: a lock that held every load may be any larger one."""
        low, high = self.interval
        return low * high <= 0 or max(low / high, high / low) > UNBOUND


def magnitudes(limb: LimbVerdict) -> list[Magnitude]:
    """The effects of a limb's verdict."""
    whole = limb.attribution.whole
    fitter, fit = settled(whole, limb.chosen.fit)
    other_law = fitter is whole and limb.chosen.surprise > rules().white_sd
    ends = intervals(fitter, fit, whole.evidence, other_law)
    found = []
    for name, effect, interval in zip(limb.names, fit.effects, ends, strict=True):
        size = UNITS[effect.unit][1]
        low, high = sorted(end / size for end in interval)
        found.append(
            Magnitude(
                effect=name,
                joint=effect.joint,
                value=effect.magnitude / size,
                unit=effect.unit,
                interval=(low, high),
                joints=_concerned(effect, fitter.evidence),
            )
        )
    return found


def _concerned(effect: Effect, evidence: Evidence) -> tuple[str, ...]:
    """Joints of a limb that an effect acts on."""
    if effect.joint is not None:
        return (effect.joint,)
    changed = zip(evidence.nominal.hand.driven, evidence.world((effect,)).hand.driven, strict=True)
    moved = tuple(a.joint.name for a, b in changed if a != b)
    return moved or evidence.joints


def merge(found: list[Magnitude]) -> tuple[Magnitude, ...]:
    """One effect that limbs agree on is one finding on all its joints."""
    merged: list[Magnitude] = []
    for one in found:
        twin = next((m for m in merged if m.effect == one.effect and _agree(m, one)), None)
        if twin is None:
            merged.append(one)
            continue
        value, interval = _together(twin, one)
        merged[merged.index(twin)] = Magnitude(
            effect=one.effect,
            joint=None,
            value=value,
            unit=one.unit,
            interval=interval,
            joints=(*twin.joints, *one.joints),
        )
    return tuple(merged)


def _together(a: Magnitude, b: Magnitude) -> tuple[float, tuple[float, float]]:
    """Value and interval of two that agree: weighed by precision, or of the one that is bounded.

    Of two that are not, the larger one: as large as each asks for, and neither forbids it.
    """
    if a.loose != b.loose:
        bound = b if a.loose else a
        return bound.value, bound.interval
    if a.loose:
        larger = max(a, b, key=lambda m: abs(m.value))
        ends = [sorted(m.interval, key=abs) for m in (a, b)]
        low, high = max(ends[0][0], ends[1][0], key=abs), min(ends[0][1], ends[1][1], key=abs)
        return larger.value, (min(low, high), max(low, high))
    weights = [1 / max(m.interval[1] - m.interval[0], 1e-12) ** 2 for m in (a, b)]
    value = float(np.average([a.value, b.value], weights=weights))
    half = (1 / sum(weights)) ** 0.5 / 2
    return value, (value - half, value + half)


def _agree(a: Magnitude, b: Magnitude) -> bool:
    overlap = a.interval[0] <= b.interval[1] and b.interval[0] <= a.interval[1]
    return overlap or abs(a.value - b.value) < 0.1 * max(abs(a.value), abs(b.value))
