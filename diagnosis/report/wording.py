"""What a diagnosis says in plain words, the same on the terminal and on the page."""

from collections.abc import Iterable, Mapping
from typing import Any

from backends.effect import UNITS, Effect
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.rules import Rules
from diagnosis.attribution.verdict import NONE, UNKNOWN
from diagnosis.beside.finding import Finding
from diagnosis.diagnose import Diagnosis
from diagnosis.leading import Leading
from diagnosis.shrinkage import Share

NEARLY_ALL = 0.95
"""A share of a gap that is not too little to be the verdict."""
NOMINAL = "nominal parameters alone"
"""What the candidate without an effect is called."""


VERDICT, BEST = "the verdict", "the best that was found"
"""What a world with effects is called, where it is accepted and where it is not."""


def sentence(found: Diagnosis) -> str:
    """The verdict in one or two sentences."""
    if found.verdict == (NONE,):
        sound = any(limb.attribution.fitter.evidence.sound for limb in found.limbs)
        beyond = " beyond what healthy logs show" if sound else ""
        return (
            f"No effect is needed{beyond}: the nominal world explains this log within the "
            "uncertainty of its parameters."
        )
    parts = []
    if found.magnitudes:
        others = [_worlds(row)[1] for row in found.indistinguishable]
        also = f", or as well by {' or '.join(others)}" if others else ""
        explained = listed(phrase(m) for m in found.magnitudes)
        whole = "Part of the gap" if UNKNOWN in found.verdict else "The gap"
        parts.append(f"{whole} is explained by {explained}{also}.")
    if UNKNOWN in found.verdict:
        where = _strange(found)
        there = f"{where[0].upper()}{where[1:]} there" if where else "There"
        parts.append(f"{there} is a gap that no effect of the catalogue explains.")
        parts += [_led(one) for one in found.leading]
    return " ".join(parts)


def _led(one: Leading) -> str:
    """What an unknown gap is mostly like."""
    what = f"{one.effect} of {number(one.value)} {one.unit} on {one.joint or listed(one.limb)}"
    others = f"every effect but {listed(one.tied)}" if one.tied else "every other effect"
    taken = f"takes {percent(one.share)} of the squared gap that the nominal parameters leave"
    if one.share.value <= 0.0:
        taken = "moves nothing by more than the noise floor"
    why = "too little to be the verdict"
    if one.share.value > NEARLY_ALL:
        why = "but what it leaves, or how far it bends nominal parameters, is beyond belief"
    return f"Nearest is {what}, ahead of {others}: it {taken}, {why}."


def healthy(told: Mapping[str, Any], base: Rules) -> str:
    """What healthy logs ask of a verdict: `told` as diagnosis.json has it, beside the rules."""
    asked = []
    for limb in told["limbs"]:
        rule = limb["rules"]
        wider = [
            f"{what} up to {number(rule[name])} {unit} (else {number(getattr(base, name))})"
            for name, what, unit in _EXCUSED
            if rule[name] > getattr(base, name)
        ]
        wider += [
            f"{one['effect']} up to {number(one['magnitude'])} {one['unit']}"
            for one in limb["excused"]
        ]
        joints = listed(limb["joints"])
        asked.append(f"on {joints} {listed(wider) if wider else 'nothing more'} is excused")
    return f"by {len(told['logs'])}: {'; '.join(asked)}"


_EXCUSED = (
    ("white_sd", "what is not white by", "deviations"),
    ("uneven_sd", "one protocol by", "deviations"),
    ("law_nats", "what follows the motion by", "nats"),
    ("alone_stds", "a nominal parameter that is off by", "of its deviations"),
)
"""Rules that healthy logs widen: what they are about, and in what."""


def _strange(found: Diagnosis) -> str:
    """Where the gap is unknown: 'on J3', 'in touch', or nothing."""
    accused = {joint for m in found.magnitudes for joint in m.joints}
    strange = [joint for joint in found.joints if joint not in accused]
    families = [one.family for one in found.beside if one.effect == UNKNOWN]
    places = [f"on {listed(strange)}"] if strange else []
    return listed([*places, *(f"in {family}" for family in families)])


def phrase(magnitude: Magnitude) -> str:
    """A finding with its interval, such as 'backlash of 1.02 deg (0.99 to 1.05) on J3'."""
    where = f" on {listed(magnitude.joints)}" if magnitude.joints else ""
    return f"{magnitude.effect} of {size(magnitude)}{where}"


def size(magnitude: Magnitude) -> str:
    """A magnitude with its interval."""
    low, high = magnitude.interval
    interval = "not bounded by this log" if magnitude.loose else f"{number(low)} to {number(high)}"
    return f"{number(magnitude.value)} {magnitude.unit} ({interval})"


def beside(one: Finding) -> str:
    """What says so, and how far the gap that it was judged by shrinks."""
    return (
        f"{one.effect}: {one.evidence}; its gap falls from {digits(one.gap_before)} to "
        f"{digits(one.gap_after)} times the floor"
    )


def digits(value: float) -> str:
    """A gap in three digits."""
    return f"{value:.3g}"


def candidate(ranked: Ranked) -> str:
    """A candidate and its joints, such as 'backlash@J3'."""
    pairs = zip(ranked.names, ranked.fit.effects, strict=True)
    return " + ".join(name + _place(effect) for name, effect in pairs) or NOMINAL


def _place(effect: Effect) -> str:
    if not effect.per_joint:
        return ""
    return f"@{effect.joint}" if effect.joint else ", all joints"


def amounts(ranked: Ranked) -> str:
    """The fitted magnitudes of a candidate."""
    return ", ".join(amount(effect) for effect in ranked.fit.effects)


def amount(effect: Effect) -> str:
    """The magnitude of an effect in its usual unit."""
    return f"{number(effect.magnitude / UNITS[effect.unit][1])} {effect.unit}"


def confidence(found: Diagnosis) -> str:
    """How sure the verdict is."""
    return f"{100 * found.confidence:.0f} %"


def shrinkage(found: Diagnosis) -> str:
    """How far the gap shrinks, in a sentence."""
    before, nominal, after = (spread(found.gaps[key]) for key in ("before", "nominal", "after"))
    if found.gap_before <= found.noise_floor:
        return f"In free air the gap on held-out samples is {before} times the noise floor."
    text = f"The gap on held-out samples is {before} times the noise floor"
    text += f", {nominal} with the nominal parameters refitted"
    if found.verdict == (NONE,) or found.gaps["after"] == found.gaps["nominal"]:
        return f"{text}."
    return (
        f"{text}, {after} with {after_name(found)}. That takes {percent(found.shrinkage)} of the "
        f"squared gap above the floor, the refit alone {percent(found.shrinkage_nominal)}."
    )


def after_name(found: Diagnosis) -> str:
    """What the gap `after` is measured with."""
    return BEST if UNKNOWN in found.verdict else VERDICT


def tie(row: dict) -> str:
    """Two worlds that a log cannot tell apart, and what would."""
    first, second = _worlds(row)
    text = f"{first} and {second} fit alike ({row['apart_nats']:.1f} nats apart)"
    if row["experiment"] is None:
        return f"{text}; no channel or protocol that this log lacks would separate them"
    if row["experiment"] not in row["separations_sd"]:
        return f"{text}; {row['experiment']}"
    apart = row["separations_sd"][row["experiment"]]
    return f"{text}; {row['experiment']}: that would set them {apart:.1f} deviations apart"


def _worlds(row: dict) -> list[str]:
    """The two sides of a tie, such as 'backlash@J3'."""
    pairs = zip(row["effects"], row["joints"], strict=True)
    return [effect if joint is None else f"{effect}@{joint}" for effect, joint in pairs]


def spread(share: Share) -> str:
    """A value with its interval."""
    value, low, high = (
        f"{v:.2f}" if abs(v) < 10 else f"{v:.3g}" for v in (share.value, *share.interval)
    )
    return f"{value} ({low} to {high})"


def percent(share: Share) -> str:
    """A share with its interval in percent."""
    return "{:.1f} % ({:.1f} to {:.1f})".format(*(100 * v for v in (share.value, *share.interval)))


def number(value: float) -> str:
    """Three or four digits, never an exponent where none is needed."""
    return f"{value:.4g}" if abs(value) >= 0.001 or value == 0 else f"{value:.2g}"


def listed(items: Iterable[str]) -> str:
    """Words as a list: 'a, b and c'."""
    words = list(items)
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
