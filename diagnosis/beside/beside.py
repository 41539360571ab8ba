"""Findings without replays of free air: sensors and lost packets.

A diagnosis calls `sensed` before it judges limbs, `lost` afterwards.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from backends.effect import UNITS, Effect, with_effects
from backends.spec import Spec
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.magnitudes import Magnitude
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import NONE, UNKNOWN, LimbVerdict
from diagnosis.beside.fingerprints import sensors
from diagnosis.beside.losses import dropouts
from diagnosis.finding import Finding

LOST, STEPS = "command-dropout", "encoder-resolution"


def sensed(parts: Sequence[Evidence], catalogue: Mapping[str, type[Effect]]) -> tuple[Finding, ...]:
    """Noise and steps of position sensors that are above what a diagnosis takes as nothing."""
    floor = {n: part.floor[0, 0, j] for part in parts for j, n in enumerate(part.joints)}
    return tuple(
        one
        for one in sensors(parts, catalogue)
        if one.effect == UNKNOWN or _std(one) > max(floor[n] for n in one.joints)
    )


def _std(found: Finding) -> float:
    """Standard deviation of the error that a sensor's effect makes [rad or m]."""
    return found.value / float(np.sqrt(12)) if found.effect == STEPS else found.value


def lost(
    parts: Sequence[Evidence],
    limbs: Sequence[LimbVerdict],
    catalogue: Mapping[str, type[Effect]],
) -> tuple[tuple[Finding, ...], tuple[Evidence, ...]]:
    """Lost packets, and the parts with the commands that arrived.

    `limbs` are the verdicts on `parts`, one each.
    """
    return dropouts(parts, limbs) if LOST in catalogue else ((), tuple(parts))


def corrected(
    nominal: Spec, found: Sequence[Finding], catalogue: Mapping[str, type[Effect]]
) -> Spec:
    """The nominal world with what was found."""
    effects = (
        catalogue[one.effect](magnitude=one.value, joint=joint)
        for one in found
        if one.effect in catalogue
        for joint in one.joints or (None,)
    )
    return with_effects(nominal, effects)


def outdone(limb: LimbVerdict, found: Sequence[Finding]) -> Finding | None:
    """The finding that takes the place of a limb's verdict; None where there is none."""
    joints = set(limb.attribution.fitter.evidence.joints)
    return next(
        (one for one in found if getattr(one, "instead", False) and joints & set(one.joints)), None
    )


def magnitude(one: Finding, catalogue: Mapping[str, type[Effect]]) -> Magnitude | None:
    """A finding as the diagnosis lists it, in the unit of its effect; None of an unknown."""
    if one.effect == UNKNOWN:
        return None
    unit = catalogue[one.effect].unit
    size = UNITS[unit][1]
    return Magnitude(
        effect=one.effect,
        joint=one.joint,
        value=one.value / size,
        unit=unit,
        interval=(one.interval[0] / size, one.interval[1] / size),
        joints=one.joints,
    )


def ranking_of(one: Finding, catalogue: Mapping[str, type[Effect]]) -> list[dict]:
    """A finding and what it is ahead of, as the ranking lists candidates."""
    said = magnitude(one, catalogue)
    bare = {
        "limb": [one.family, *one.joints],
        "effects": [NONE],
        "joints": [],
        "magnitudes": [],
        "units": [],
        "cost_nats": one.lead_nats,
        "gap": one.gap_before,
    }
    if said is None:
        return []
    named = {
        "effects": [one.effect],
        "joints": [one.joint],
        "magnitudes": [said.value],
        "units": [said.unit],
        "cost_nats": 0.0,
        "gap": one.gap_after,
    }
    return [bare | named, bare]


def told_apart(one: Finding) -> list[dict]:
    """The effects that a log cannot tell from a finding, and what to do."""
    return [
        {
            "effects": [one.effect, other],
            "joints": [one.joint, one.joint],
            "apart_nats": nats,
            "experiment": one.experiment,
            "needed_sd": float(np.sqrt(2 * rules().tie_nats)),
            "separations_sd": {},
        }
        for other, nats in one.ties
    ]
