"""What was found: fitted effects with their magnitudes, and one finding where limbs agree."""

from dataclasses import dataclass

import numpy as np

from backends.effect import UNITS, Effect
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.intervals import intervals, settled
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import LimbVerdict


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
        weights = [1 / max(m.interval[1] - m.interval[0], 1e-12) ** 2 for m in (twin, one)]
        value = float(np.average([twin.value, one.value], weights=weights))
        half = (1 / sum(weights)) ** 0.5 / 2
        merged[merged.index(twin)] = Magnitude(
            effect=one.effect,
            joint=None,
            value=value,
            unit=one.unit,
            interval=(value - half, value + half),
            joints=(*twin.joints, *one.joints),
        )
    return tuple(merged)


def _agree(a: Magnitude, b: Magnitude) -> bool:
    overlap = a.interval[0] <= b.interval[1] and b.interval[0] <= a.interval[1]
    return overlap or abs(a.value - b.value) < 0.1 * max(abs(a.value), abs(b.value))
