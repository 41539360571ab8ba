"""Effects as written on the command line: none, or such as built,kp-scale=-10%@J3."""

import math
import re
from collections.abc import Iterable, Mapping

from backends.effect import UNITS, Effect
from backends.spec import Hand
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
_ITEM = re.compile(r"([a-z-]+)=([-+0-9.eE]+)([A-Za-z%0-9/]*)(?:@(\w+))?")
_FORM = "NAME=NUMBER[UNIT][@JOINT], for example backlash=1.2deg@J3"


def parse_effects(text: str, hand: Hand) -> tuple[Effect, ...]:
    """The effects that `text` names, in order; raises UsageError for an invalid text."""
    if text in ("none", ""):
        return ()
    items = [item.strip() for item in text.split(",")]
    if "none" in items:
        raise UsageError(f"'{text}' has 'none' and other effects; leave one of them out")
    items = [part for item in items for part in (BUILT if item == "built" else item).split(",")]
    effects = tuple(_parse_one(item, hand) for item in items)
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


def _parse_one(item: str, hand: Hand) -> Effect:
    match = _ITEM.fullmatch(item)
    if match is None:
        name = re.split("[=@]", item)[0]
        if name not in registry.names("effect"):
            raise unknown("effect", name, (*registry.names("effect"), "built", "none"))
        raise UsageError(f"cannot read the effect '{item}'; allowed: {_FORM}")
    name, number, unit, joint = match.groups()
    if name not in registry.names("effect"):
        raise unknown("effect", name, (*registry.names("effect"), "built", "none"))
    kind: type[Effect] = registry.load("effect", name)
    magnitude = _magnitude(item, kind, number, unit)
    if joint is not None and not kind.per_joint:
        raise UsageError(
            f"'{item}' names a joint, but {name} does not act on joints; leave '@{joint}' out"
        )
    if joint is not None and joint not in hand.joint_names:
        raise unknown("driven joint", joint, hand.joint_names)
    return kind(magnitude=magnitude, joint=joint)


def _magnitude(item: str, kind: type[Effect], number: str, unit: str) -> float:
    units = [name for name, (dimension, _) in UNITS.items() if dimension == kind.dimension]
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
