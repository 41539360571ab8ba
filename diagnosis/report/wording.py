"""The sentences of a diagnosis, the same on the terminal and in the report."""

from collections.abc import Iterable, Mapping
from typing import Any

from backends.effect import UNITS, Effect
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.rules import Rules
from diagnosis.attribution.verdict import NONE, UNKNOWN
from diagnosis.diagnose import Diagnosis
from diagnosis.finding import Finding
from diagnosis.leading import Leading
from diagnosis.shrinkage import Share

NEARLY_ALL = 0.95
"""From this share of a gap on, the share is not what keeps an effect from being the verdict."""
NOMINAL = "nominal parameters alone"
"""Name of the candidate without an effect."""


VERDICT, BEST = "the verdict", "the best candidate"
"""Names of the world with effects: of an accepted candidate, and of one that is not."""


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
        where = _unknown_where(found)
        there = f"{where[0].upper()}{where[1:]} there" if where else "There"
        parts.append(f"{there} is a gap that no effect of the catalogue explains.")
        parts += [_led(one) for one in found.leading]
    return " ".join(parts)


def _led(one: Leading) -> str:
    """The effect that is closest to an unknown gap."""
    what = f"{one.effect} of {number(one.value)} {one.unit} on {one.joint or listed(one.limb)}"
    others = f"every effect but {listed(one.tied)}" if one.tied else "every other effect"
    taken = f"explains {percent(one.share)} of the squared gap left by the nominal parameters"
    if one.share.value <= 0.0:
        taken = "changes nothing by more than the noise floor"
    why = "which is too little for a verdict"
    if one.share.value > NEARLY_ALL:
        why = "but its residual, or the shift of nominal parameters that it needs, is too large"
    return f"The closest effect is {what}, ahead of {others}: it {taken}, {why}."


def healthy(allowed: Mapping[str, Any], base: Rules) -> str:
    """What healthy logs allow, beyond the default rules: `allowed` is as in diagnosis.json."""
    asked = []
    for limb in allowed["limbs"]:
        rule = limb["rules"]
        wider = [
            f"{what} up to {number(rule[name])} {unit} (default {number(getattr(base, name))})"
            for name, what, unit in _EXCUSED
            if rule[name] > getattr(base, name)
        ]
        wider += [
            f"{one['effect']} up to {number(one['magnitude'])} {one['unit']}"
            for one in limb["excused"]
        ]
        joints = listed(limb["joints"])
        asked.append(f"{joints}: {listed(wider) if wider else 'no more than by default'}")
    return f"{len(allowed['logs'])} used; they allow on {'; on '.join(asked)}"


_EXCUSED = (
    ("white_sd", "a residual that is not white by", "standard deviations"),
    ("uneven_sd", "a residual of one protocol by", "standard deviations"),
    ("law_nats", "a residual that follows the motion by", "nats"),
    ("alone_stds", "a nominal parameter that is off by", "prior standard deviations"),
)
"""The rules that healthy logs widen: what each is about, and its unit."""


def _unknown_where(found: Diagnosis) -> str:
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


def finding(one: Finding) -> str:
    """The evidence for a finding, and how far its gap shrinks."""
    return (
        f"{one.effect}: {one.evidence}; its gap falls from {digits(one.gap_before)} to "
        f"{digits(one.gap_after)} times the noise floor"
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
        return (
            f"In free air the gap is {before} times the noise floor, on samples not used in fits."
        )
    text = f"The gap is {before} times the noise floor, on samples not used in fits. "
    text += f"Refitting the nominal parameters leaves {nominal}"
    if found.verdict == (NONE,) or found.gaps["after"] == found.gaps["nominal"]:
        return f"{text}."
    name = after_name(found)
    return (
        f"{text}, adding {name} leaves {after}. {name.capitalize()} removes "
        f"{percent(found.shrinkage)} of the squared gap above the noise floor; "
        f"the refit alone removes {percent(found.shrinkage_nominal)}."
    )


def after_name(found: Diagnosis) -> str:
    """Name of the world that the gap `after` is measured with."""
    return BEST if UNKNOWN in found.verdict else VERDICT


def tie(row: dict) -> str:
    """Two worlds that a log cannot distinguish, and the experiment that would."""
    first, second = _worlds(row)
    text = (
        f"{first} and {second} fit almost equally well "
        f"(log evidence ratio {row['apart_nats']:.1f} nats)"
    )
    if row["experiment"] is None:
        return f"{text}; no channel or protocol that is missing in this log would separate them"
    if row["experiment"] not in row["separations_sd"]:
        return f"{text}; to distinguish them, {row['experiment']}"
    apart = row["separations_sd"][row["experiment"]]
    return (
        f"{text}; to distinguish them, {row['experiment']}: that would separate them by "
        f"{apart:.1f} standard deviations"
    )


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
    """A number with two to four digits, without an exponent where possible."""
    return f"{value:.4g}" if abs(value) >= 0.001 or value == 0 else f"{value:.2g}"


def listed(items: Iterable[str]) -> str:
    """Words as a list: 'a, b and c'."""
    words = list(items)
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
