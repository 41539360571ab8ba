"""Ordinary: the gap that a healthy robot leaves beside its model. The decision is made here.

All gaps are in floors; a share is of the squared gap beyond one floor (`Fit.excess`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import excess

SHARE = 0.7
"""A cause is named where it takes so much of the gap, and a further one of what the others leave:
less, and it is a part of something else."""
FURTHER = 0.5
"""Lost packets take so much of what causes leave."""
LAW_MOST = 3.0
"""So many ordinary gaps more is the most that a law's own error leaves: beyond, it is another."""
ABSURD = 1000.0
"""A gap of so many floors is a file of another robot: what closes it has no name, but for what
leaves an ordinary one."""
SHAPE, SHAPE_LEFT = 0.9, 1.3
"""In a gap that was ordinary to begin with, size says nothing: a cause convicts by its shape, when
it takes so much and leaves so few floors."""
SHAPE_FROM = 1.4
"""Smaller gaps have no shape [floors]."""
SHAPE_LAW = 0.07
"""A rest below this share of the gap has no shape: laws that explain the gap are off by it."""
HEALTHY_MORE, HEALTHY_LEAST = 1.3, 1.2
"""Of healthy logs, their largest gap times this is ordinary, and never less than this."""


@dataclass(frozen=True, kw_only=True)
class Ordinary:
    """How large a healthy gap is, and where that number comes from."""

    floors: float
    source: str
    """`robot`, `simulator` or `healthy logs`."""
    law: float
    """A cause may leave this share of the gap that it explains: its law is a model of many."""
    exact: bool
    """Whether the law is ours, so that likelihoods may name causes as well (`verdict.exact`)."""
    step_rad: float
    """Largest quantisation step of an ordinary position sensor [rad; of a slide, of its travel]."""
    everyday: float
    """Share of the everyday tolerances (play, twist, delay, friction) that such a mechanism has."""


ROBOTS = Ordinary(floors=3.5, source="robot", law=0.3, exact=False, step_rad=1.7e-3, everyday=1.0)
"""Healthy ones with other drive laws leave 0.5 to 5 floors; between 3 and 3.5 little changes. Their
encoders have 12 bits a turn and more."""
SIMULATORS = Ordinary(
    floors=1.3, source="simulator", law=0.05, exact=True, step_rad=7e-4, everyday=0.3
)
"""With our drive law they leave the noise, and what their integrators do otherwise. Their encoders
have no steps by themselves."""


def of_healthy(gaps: Sequence[float], origin: Ordinary) -> Ordinary:
    """What is ordinary by the gaps that logs of the healthy robot leave."""
    floors = max(HEALTHY_MORE * max(gaps), HEALTHY_LEAST)
    return replace(origin, floors=floors, source="healthy logs")


def doubts(gaps: Sequence[float], origin: Ordinary) -> Iterator[str]:
    """Which healthy logs leave more beside another than a law's own error, in words."""
    if not gaps:
        return
    most = max(origin.floors, LAW_MOST * of_healthy([min(gaps)], origin).floors)
    for number, gap in enumerate(gaps, 1):
        if gap > most:
            yield (
                f"healthy log {number} of {len(gaps)} leaves {gap:.1f} times the noise floor, and "
                f"another {min(gaps):.1f}: leave it out if something was wrong then, for it hides "
                "as much now"
            )


LOSSES = 0.3
"""Lost packets that do not show are not found: they leave this share of what losses take, as a law
leaves its own."""
LEAST_EXCESS = 1e-6
"""A smaller excess is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Gap:
    """What a set of causes leaves."""

    gap2: Array
    """Squared gap by joint (K,); of touch and stick one for all."""
    strain2: float = 0.0
    """Squared gap that the tolerances together are worth, see `Usual`; 0 where they are usual."""

    @cached_property
    def excess(self) -> float:
        """Squared gap beyond one floor, over all joints, and of the tolerances together."""
        return excess(self.gap2) + self.strain2

    @property
    def gap(self) -> float:
        """The largest gap of a joint."""
        return float(np.sqrt(self.gap2.max()))

    @property
    def worst(self) -> float:
        """The largest gap of a joint, or of the tolerances together."""
        return max(self.gap, float(np.sqrt(self.strain2)))


def share_of(fit: Gap, before: Gap) -> float:
    """The share of an excess that a set of causes takes; 0 of none, and at least -1."""
    if before.excess < LEAST_EXCESS:
        return 0.0
    return max(1.0 - fit.excess / before.excess, -1.0)


def is_named(fit: Gap, nominal: Gap, ordinary: Ordinary) -> bool:
    """Whether a set of causes is named: by what it takes and leaves, or else by its shape."""
    share = share_of(fit, nominal)
    if nominal.gap <= ordinary.floors:
        return _has_shape(share, fit, nominal)
    left = allowed(nominal.worst, ordinary)
    is_some = nominal.worst < ABSURD or fit.worst <= ordinary.floors
    return share >= SHARE and fit.worst <= left and is_some


def allowed(explained: float, ordinary: Ordinary) -> float:
    """What may be left of a gap that was explained: what is ordinary, and the law's own error."""
    return ordinary.floors + min(ordinary.law * explained, LAW_MOST * ordinary.floors)


def is_worth(fit: Gap, before: Gap, ordinary: Ordinary, nominal: Gap) -> bool:
    """Whether one more cause is worth it: it takes of what the others leave what one takes alone.

    Or it takes so much of what is left on a joint that leaves more than an ordinary gap: joints may
    have a cause each. Of an ordinary rest it takes nearly all, as of an ordinary gap, and of more
    than the others' laws may be off by.
    """
    share = share_of(fit, before)
    if before.worst <= ordinary.floors:
        beyond = before.worst >= SHAPE_LAW * nominal.worst
        return beyond and _has_shape(share, fit, before)
    own, left = (
        np.maximum(one.gap2[before.gap2 > ordinary.floors**2] - 1.0, 0.0) for one in (before, fit)
    )
    return share >= SHARE or (share > 0.0 and bool((left <= (1.0 - SHARE) * own).any()))


def _has_shape(share: float, fit: Gap, before: Gap) -> bool:
    """Whether causes take nearly all of a gap that was ordinary, and leave less than a floor."""
    return before.worst >= SHAPE_FROM and share >= SHAPE and fit.worst <= SHAPE_LEFT
