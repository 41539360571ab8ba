"""The effect that is closest to an unknown gap, although it does not explain the gap."""

from collections.abc import Iterable
from dataclasses import dataclass

from backends.effect import UNITS
from diagnosis.attribution.verdict import LimbVerdict
from diagnosis.shrinkage import Share, shrinkage


@dataclass(frozen=True, kw_only=True)
class Leading:
    """The effect that explains most of an unknown gap."""

    effect: str
    joint: str | None
    """None: every joint that the effect concerns."""
    limb: tuple[str, ...]
    """Joints of the limb."""
    value: float
    """In `unit`."""
    unit: str
    share: Share
    """Share of the squared gap above the noise floor that the nominal refit leaves."""
    tied: tuple[str, ...] = ()
    """An effect that cannot be distinguished from it."""


def leading(limbs: Iterable[LimbVerdict]) -> tuple[Leading, ...]:
    """The effects that lead in limbs whose gap is unknown."""
    return tuple(_leading(limb) for limb in limbs if limb.leading)


def _leading(limb: LimbVerdict) -> Leading:
    best, *tied = limb.leading
    (name,), (effect,) = best.names, best.fit.effects
    return Leading(
        effect=name,
        joint=effect.joint,
        limb=limb.attribution.fitter.evidence.joints,
        value=effect.magnitude / UNITS[effect.unit][1],
        unit=effect.unit,
        share=shrinkage(limb.attribution.nominal.plain, best.plain),
        tied=tuple(name for one in tied for name in one.names),
    )
