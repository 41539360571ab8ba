"""What is said of a log, as plain data: no arrays, no fits, to JSON and back."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from backends.catalogue import Catalogue
from backends.effect import UNITS, Effect
from backends.spec import Spec


@dataclass(frozen=True, kw_only=True)
class JointFacts:
    """What sizes on some joints are said by."""

    slides: bool = False
    """Whether all of them slide."""
    count: float = 0.0
    """A count of their encoders [rad or m]; 0: unknown."""
    mass_kg: float = 0.0
    """Mass of the link of a single one [kg]; 0: of several."""
    ends: tuple[float, float] | None = None
    """Range of a single one [rad or m]; None: of several."""
    stiffness: float = 0.0
    """Stiffness of the gear of a single one [Nm/rad or N/m]; 0: of several."""
    geared: bool = True
    """Whether the nominal world has that gear; else it is what a share is of."""


ANYWHERE = JointFacts()


def in_other_words(kind: type[Effect], size: float, unit: str, at: JointFacts = ANYWHERE) -> str:
    """A size [SI] said in a unit: from side to side, beside degrees, counts, kg, where; or none."""
    if kind.coordinate == "reach" and at.ends is not None:
        end = (at.ends[1] if size > 0.0 else at.ends[0]) - size
        return f"at {end / UNITS[unit][1]:.3g} {unit}"
    size *= kind.whole
    found = []
    if kind.whole != 1.0:
        found.append(f"whole {size / UNITS[unit][1]:.3g} {unit}")
    if kind.dimension == "angle" and unit in kind.units():
        other = "mrad" if unit == "deg" else "deg"
        found.append(f"{size / UNITS[other][1]:.3g} {other}")
    if kind.dimension == "angle" and 0.0 < abs(size) < MOST_COUNTS * at.count:
        found.append(f"{size / at.count:.3g} counts")
    if kind.is_of("body") and at.mass_kg > 0.0:
        found.append(f"{size * at.mass_kg:.3g} kg")
    if kind.coordinate == "compliance" and at.stiffness > 0.0:
        firm = "N/m" if at.slides else "Nm/rad"
        found.append(f"stiffness {at.stiffness / (at.geared + size):.3g} {firm}")
    return ", ".join(found)


def distance(size: float, spec: Spec) -> str:
    """A distance of a world's positions [rad, of slides m] in words."""
    slides = {body.joint.slides for body in spec.hand.driven}
    if slides == {True}:
        return f"{1e3 * size:.3g} mm"
    turned = f"{1e3 * size:.3g} mrad ({np.degrees(size):.2g} deg"
    return f"{turned}; of slides mm)" if True in slides else f"{turned})"


MOST_COUNTS = 1e4
"""A size of more counts is not said in them."""
NONE, UNKNOWN = "none", "unknown"
Z90 = 1.645
"""Half of a 90 % interval, in standard deviations."""
CLOSE_NATS = 1.35
"""Half of the 90 % point of a squared normal number: ends of an interval of a likelihood."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One effect, named or leading."""

    effect: str
    joint: str | None
    """None: all joints, or an effect that concerns none."""
    joints: tuple[str, ...]
    value: float
    """In `unit`; so are low and high, the ends of its 90 % interval."""
    low: float
    high: float
    unit: str
    share: float = 0.0
    """Share of the gap that it takes by itself."""
    also: str = ""
    """The value in other words: from side to side, in radians, in counts of the encoder."""
    shape: tuple[str, ...] = ()
    """Effects of its family with their sizes, which give its law more shape on that joint: no
    causes themselves."""
    evidence: str = ""
    """What in the log says so, of touch and stick."""
    tied: tuple[str, ...] = ()
    """Effects on touch and stick that this log cannot distinguish from it."""

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Value, low and high in SI units or as shares."""
        per = UNITS[self.unit][1] if self.unit else 1.0
        return self.value * per, self.low * per, self.high * per


def cause(
    effect: str,
    sizes: Sequence[float],
    kinds: Catalogue,
    joints: tuple[str, ...] = (),
    at: JointFacts = ANYWHERE,
    **more: Any,
) -> Cause:
    """A cause of a value, low and high in SI units or as shares; `more`: its other fields.

    `kinds`: has the effect, unless it is `unknown`. `at`: see `Evidence.place`.
    """
    kind = kinds.get(effect)
    unit = kind.unit_of(sizes[0], at.slides) if kind else ""
    value, low, high = (float(size) / (UNITS[unit][1] if unit else 1.0) for size in sizes)
    return Cause(
        effect=effect,
        joint=joints[0] if len(joints) == 1 else None,
        joints=joints,
        value=value,
        low=low,
        high=high,
        unit=unit,
        also=in_other_words(kind, float(sizes[0]), unit, at) if kind else "",
        **more,
    )


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """A nominal number that took part of the gap."""

    effect: str
    joint: str
    value: float
    """How far it moved, in `unit`: a share of the number in the file where that is not zero."""
    sd: float
    """Standard deviation of the fit alone, in `unit`."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A set of causes that was tried."""

    causes: tuple[tuple[str, str | None], ...]
    """Effects and their joints."""
    share: float
    left: float
    """The largest gap of a joint that it leaves [floors]."""


@dataclass(frozen=True, kw_only=True)
class LimbResult:
    """What is said of one limb."""

    joints: tuple[str, ...]
    verdict: tuple[str, ...]
    """Names of effects, `none` or `unknown`."""
    causes: tuple[Cause, ...]
    """What is named."""
    leading: tuple[Cause, ...]
    """The first causes, whatever is named."""
    sensors: tuple[Cause, ...]
    """Findings about sensors and packets, beside the verdict."""
    share: float
    left: float
    ordinary: float
    ordinary_from: str
    probability: float
    ranking: tuple[Ranked, ...]
    tied: tuple[tuple[str, ...], ...]
    experiment: str | None
    gap_before: float
    gap_nominal: float
    gaps: dict[str, float]
    """By joint, what the tolerances leave [floors]."""
    nominal: tuple[Nominal, ...]
    sentences: tuple[str, ...] = ()
    law: str = ""
    """Terms of drives that no file says, in words: what is left is with them."""
    rested: dict[str, dict[str, float]] | None = None
    """Numbers of the corrected world by joint, where rests and no fit show what is named."""
    strain: float = 0.0
    """How much further off the nominal numbers would be together than a healthy robot's, in
    standard deviations; 0 where they are usual."""


def named(limbs: Sequence[LimbResult]) -> list[Cause]:
    """What is named, by effect; one that every joint has alike, or that has no joint, is one."""
    joints = tuple(chain.from_iterable(limb.joints for limb in limbs))
    said = [c for limb in limbs for c in (*limb.causes, *limb.sensors) if c.effect != UNKNOWN]
    found: list[Cause] = []
    for effect in dict.fromkeys(c.effect for c in said):
        same = [c for c in said if c.effect == effect]
        covered = list(chain.from_iterable(c.joints for c in same))
        lows, highs = zip(*(c.sizes[1:] for c in same), strict=True)
        alike = len({UNITS[c.unit][0] for c in same}) == 1 and max(lows) <= min(highs)
        if len(same) > 1 and sorted(covered) == sorted(joints) and alike:
            middle = sorted(same, key=lambda c: c.sizes[0])[len(same) // 2]
            found.append(replace(middle, joint=None, joints=joints))
        else:
            found.extend(same)
    return found


def verdict(limbs: Sequence[LimbResult], more: Sequence[Cause] = ()) -> tuple[str, ...]:
    """Names of effects, with `more` causes, or none; unknown where a gap or a cause has no name."""
    said = [one for limb in decisive(limbs) for one in limb.verdict]
    said += [cause.effect for limb in limbs for cause in limb.sensors]
    said += [cause.effect for cause in more]
    found = (UNKNOWN,) if UNKNOWN in said else dict.fromkeys(one for one in said if one != NONE)
    return tuple(found) or (NONE,)


def decisive(limbs: Sequence[LimbResult]) -> list[LimbResult]:
    """The limbs that a verdict rests on: those at fault, or all where none is.

    Not those whose gap has no name, beside a larger one that has.
    """
    largest = max((limb.gap_nominal for limb in limbs if limb.causes), default=0.0)
    faulty = [limb for limb in limbs if limb.verdict != (NONE,)]
    return [one for one in faulty if one.causes or one.gap_nominal > largest] or list(limbs)


TOUCH, STICK = "touch", "stick"


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
    """Causes, where they show, and what a log does not tell."""

    causes: tuple[Cause, ...] = ()
    """`unknown` among them, where a gap has no name."""
    spots: tuple[Spot, ...] = ()
    missing: tuple[str, ...] = ()
    """Why effects could not be looked for, and what to record for them."""
    world: Spec | None = None
    """The nominal world with the shapes that were found, named or not; None: as it was."""

    def __add__(self, other: "Report") -> "Report":
        """Both, in this order; the world is the later one."""
        return Report(
            causes=(*self.causes, *other.causes),
            spots=(*self.spots, *other.spots),
            missing=(*self.missing, *other.missing),
            world=other.world or self.world,
        )


def missing(names: Iterable[str], why: str) -> Report:
    """That effects could not be looked for; nothing of none."""
    said = ", ".join(names)
    return Report(missing=(f"{said}: {why}",) if said else ())
