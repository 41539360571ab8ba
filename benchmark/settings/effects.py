"""Effects as written on the command line: none, or such as built,kp-scale=-10%@J3."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from backends.effect import UNITS, Effect
from backends.spec import Hand, Spec
from benchmark.errors import UsageError, unknown
from benchmark.parts import registry
from files.plugins import name_of

BUILT = "backlash=1deg,self-lock=10Nm"
"""The hand as built: the default effects of every engine."""
PAPER_SPREAD = (
    "kp-scale=5%,kd-scale=5%,series-elasticity=10%,gear-damping=10%,"
    "stick-mass=30%,stick-radius=10%,contact-friction=50%"
)
"""Domain randomisation: standard deviations, and half widths for stick and contact.

The paper gives no width for friction. With half of it, policies learn a squeeze that also holds in
other engines.
"""
Kinds = Mapping[str, type[Effect]]
_ITEM = re.compile(r"([a-z-]+)=([-+0-9.eE]+)([A-Za-z%0-9/]*)(?:@(\w+))?")
_FORM = "NAME=NUMBER[UNIT][@JOINT], for example backlash=1.2deg@J3"


@dataclass(frozen=True, kw_only=True)
class EffectSet:
    """Effects, read once from what a user gave."""

    text: str
    """As they were given."""
    effects: tuple[Effect, ...]


def read_effects(text: str, hand: Hand, kinds: Kinds | None = None) -> EffectSet:
    """See `parse_effects`."""
    return EffectSet(text=text, effects=parse_effects(text, hand, kinds))


def parse_effects(text: str, hand: Hand, kinds: Kinds | None = None) -> tuple[Effect, ...]:
    """The effects that `text` names, in order; raises UsageError for an invalid text.

    `kinds`: those to take instead of the catalogue's, such as with other bounds.
    """
    if text in ("none", ""):
        return ()
    items = [item.strip() for item in text.split(",")]
    if "none" in items:
        raise UsageError(f"'{text}' has 'none' and other effects; leave one of them out")
    items = [part for item in items for part in (BUILT if item == "built" else item).split(",")]
    effects = tuple(_parse_one(item, hand, kinds or {}) for item in items)
    places = [(type(e), e.joint) for e in effects]
    if len(set(places)) < len(places):
        hint = f" (built is {BUILT})" if "built" in text else ""
        raise UsageError(f"'{text}' has an effect twice for the same joint; give each once{hint}")
    return effects


def parse_spread(text: str, hand: Hand) -> tuple[Effect, ...]:
    """The effects that domain randomisation draws; magnitudes are spreads. Raises UsageError."""
    effects = parse_effects(PAPER_SPREAD if text == "paper" else text, hand)
    for effect in effects:
        if effect.magnitude < 0:
            raise UsageError(f"the spread of {effect_name(effect)} is negative; allowed: from 0")
    return effects


def refuse(effects: Iterable[Effect], support: Mapping[str, str], backend: str) -> None:
    """Raise UsageError for an effect that the engine does not support."""
    for effect in effects:
        for field in effect.spec_fields():
            if effect.magnitude != 0.0 and support[field].startswith("refused"):
                raise UsageError(f"{effect_name(effect)} is {support[field]} ({backend})")


def effect_name(effect: Effect) -> str:
    """An effect's name on the command line."""
    return name_of(type(effect).__module__)


def effect_text(effect: Effect, spec: Spec, digits: int = 12) -> str:
    """An effect in a world as it is typed, with so many digits."""
    slides = {body.joint.name for body in spec.hand.driven if body.joint.slides}
    on_slides = set(effect.joints(spec)) <= slides and bool(slides)
    unit = effect.unit_of(effect.magnitude, on_slides)
    at = f"@{effect.joint}" if effect.joint else ""
    return f"{effect_name(effect)}={effect.magnitude / UNITS[unit][1]:.{digits}g}{unit}{at}"


def _parse_one(item: str, hand: Hand, kinds: Kinds) -> Effect:
    match = _ITEM.fullmatch(item)
    if match is None:
        name = re.split("[=@]", item)[0]
        if name not in registry.names("effect"):
            raise unknown("effect", name, (*registry.names("effect"), "built", "none"))
        raise UsageError(f"cannot read the effect '{item}'; allowed: {_FORM}")
    name, number, unit, joint = match.groups()
    if name not in registry.names("effect"):
        raise unknown("effect", name, (*registry.names("effect"), "built", "none"))
    kind: type[Effect] = kinds.get(name) or registry.load("effect", name)
    if joint is not None and not kind.per_joint:
        raise UsageError(
            f"'{item}' names a joint, but {name} does not act on joints; leave '@{joint}' out"
        )
    if joint is not None and joint not in hand.joint_names:
        raise unknown("driven joint", joint, hand.joint_names)
    slides = {b.joint.slides for b in hand.driven if joint in (None, b.joint.name)} or {False}
    units = tuple(dict.fromkeys(unit for s in sorted(slides) for unit in kind.units(s)))
    return kind(magnitude=_magnitude(item, kind, number, unit, units), joint=joint)


def _magnitude(
    item: str, kind: type[Effect], number: str, unit: str, units: tuple[str, ...]
) -> float:
    if unit not in units:
        given = f"'{unit}'" if unit else "no unit"
        raise UsageError(f"'{item}' has {given}; allowed: {', '.join(units)}")
    try:
        value = float(number) * UNITS[unit][1]
    except ValueError:
        raise UsageError(f"'{number}' in '{item}' is not a number; allowed: {_FORM}") from None
    low, high = kind.bounds
    if not (math.isfinite(value) and low <= value <= high):
        size = UNITS[unit][1]
        raise UsageError(
            f"'{item}' is out of range; allowed: {low / size:g} to {high / size:g} {unit}"
        )
    return value
