"""The diagnosis of a log: where the gap lies, which effect causes it, how far it shrinks."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from backends.effect import UNITS, Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribute import Ranked
from diagnosis.evidence import Evidence, gather
from diagnosis.locate import Place, locate
from diagnosis.log import Log
from diagnosis.verdict import NONE, UNKNOWN, LimbVerdict, judge, rules

Z90 = 1.645
"""Half width of a 90 % interval in standard deviations."""
BLOCK, RESAMPLES = 50, 400
"""Samples that are resampled together, and how often, for intervals over held-out samples."""


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


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share with its 90 % interval."""

    value: float
    interval: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a log says. Gaps are root mean squares over the noise, on held-out samples."""

    verdict: tuple[str, ...]
    joints: tuple[str, ...]
    magnitudes: tuple[Magnitude, ...]
    confidence: float
    ranking: tuple[dict, ...]
    """Per limb, what was tried: effects, joints, magnitudes, cost in nats and held-out gap."""
    indistinguishable: tuple[dict, ...]
    """Effects that this log cannot tell apart, and the experiment that would."""
    where: tuple[Place, ...]
    gap_before: float
    gap_nominal: float
    """With the nominal parameters alone refitted: what a calibration reaches."""
    gap_after: float
    noise_floor: float
    shrinkage: Share
    """Of the squared gap above the floor, by the verdict."""
    shrinkage_nominal: Share
    """The same by the refit of nominal parameters alone."""
    cpu_s: float
    limbs: tuple[LimbVerdict, ...] = field(repr=False)
    """The verdicts behind, per limb, with everything that was fitted."""


def diagnose(
    log: Log,
    nominal: Spec,
    catalogue: Mapping[str, type[Effect]],
    judge_all: Callable[[list[Evidence]], list[LimbVerdict]] | None = None,
) -> Diagnosis:
    """The diagnosis of `log` against the nominal world.

    `judge_all` may judge limbs side by side; by default one after the other. Raises LogError where
    nothing can be said.
    """
    began = time.process_time()
    rule = rules()
    floor = {
        "position": rule.floor_position_rad,
        "motor": rule.floor_position_rad,
        "torque": rule.floor_torque_share,
    }
    parts = gather(log, nominal, floor)
    uncertainty = log.meta.nominal_uncertainty
    if judge_all is None:
        limbs = [judge(part, catalogue, uncertainty) for part in parts]
    else:
        limbs = judge_all(list(parts))
    return _assemble(parts, limbs, time.process_time() - began)


def _assemble(parts: Sequence[Evidence], limbs: Sequence[LimbVerdict], cpu_s: float) -> Diagnosis:
    guilty = [limb for limb in limbs if limb.names not in ((NONE,), (UNKNOWN,))]
    magnitudes = _merge([m for limb in guilty for m in _magnitudes(limb)])
    unknown = [limb for limb in limbs if limb.names == (UNKNOWN,)]
    verdict = tuple(dict.fromkeys(m.effect for m in magnitudes))
    verdict += (UNKNOWN,) if unknown else ()
    before, nominal, after = (
        np.concatenate([of(limb) for limb in limbs])
        for of in (
            lambda limb: limb.attribution.before.plain,
            lambda limb: limb.attribution.nominal.plain,
            lambda limb: limb.chosen.plain,
        )
    )
    accused = {joint for m in magnitudes for joint in m.joints}
    strange = {joint for limb in unknown for joint in _worst(limb)}
    return Diagnosis(
        verdict=verdict or (NONE,),
        joints=tuple(j for p in parts for j in p.joints if j in accused | strange),
        magnitudes=magnitudes,
        confidence=math.prod(limb.confidence for limb in (guilty or limbs)),
        ranking=tuple(row for limb in limbs for row in _ranking(limb)),
        indistinguishable=tuple(row for limb in limbs for row in _ties(limb)),
        where=tuple(locate(parts)),
        gap_before=_rms(before),
        gap_nominal=_rms(nominal),
        gap_after=_rms(after),
        noise_floor=1.0,
        shrinkage=shrinkage(before, after),
        shrinkage_nominal=shrinkage(before, nominal),
        cpu_s=cpu_s,
        limbs=tuple(limbs),
    )


def shrinkage(before: Array, after: Array, seed: int = 0) -> Share:
    """How much of the squared gap above the noise is gone, from squared held-out residuals."""
    count = len(before) // BLOCK
    blocks = [v[: count * BLOCK].reshape(count, BLOCK).mean(axis=1) for v in (before, after)]
    draws = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    resampled = [_gone(blocks[0][d].mean(), blocks[1][d].mean()) for d in draws]
    low, high = np.percentile(resampled, [5, 95])
    return Share(value=_gone(before.mean(), after.mean()), interval=(float(low), float(high)))


def _gone(before: float, after: float) -> float:
    excess = before - 1.0
    return float(1 - max(after - 1.0, 0.0) / excess) if excess > 1e-9 else 0.0


def _rms(squares: Array) -> float:
    return float(np.sqrt(squares.mean()))


def _magnitudes(limb: LimbVerdict) -> list[Magnitude]:
    fitter, fit = limb.attribution.fitter, limb.chosen.fit
    found = []
    for index, (name, effect) in enumerate(zip(limb.names, fit.effects, strict=True)):
        size = UNITS[effect.unit][1]
        width = np.exp(min(Z90 * fitter.spread(fit, index), 50.0))
        ends = sorted((effect.magnitude / width / size, effect.magnitude * width / size))
        found.append(
            Magnitude(
                effect=name,
                joint=effect.joint,
                value=effect.magnitude / size,
                unit=effect.unit,
                interval=(ends[0], ends[1]),
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


def _merge(found: list[Magnitude]) -> tuple[Magnitude, ...]:
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


def _worst(limb: LimbVerdict) -> tuple[str, ...]:
    """The joint with most of what is left of an unknown gap."""
    places = locate([limb.attribution.fitter.evidence])
    return (places[0].joint,) if places else ()


def _row(limb: LimbVerdict, ranked: Ranked) -> dict:
    evidence = limb.attribution.fitter.evidence
    return {
        "limb": list(evidence.joints),
        "effects": list(ranked.names) or [NONE],
        "joints": list(ranked.joints),
        "magnitudes": [e.magnitude / UNITS[e.unit][1] for e in ranked.fit.effects],
        "units": [e.unit for e in ranked.fit.effects],
        "cost_nats": ranked.fit.cost,
        "gap": ranked.gap,
    }


def _ranking(limb: LimbVerdict) -> list[dict]:
    found = limb.attribution
    tried = [found.nominal, *found.singles]
    if len(limb.chosen.names) > 1:
        tried.append(limb.chosen)
    return [_row(limb, r) for r in sorted(tried, key=lambda r: r.fit.cost)]


def _ties(limb: LimbVerdict) -> list[dict]:
    return [
        {
            "effects": [limb.names[0], rival.names[0]],
            "joints": [limb.chosen.joints[0], rival.joints[0]],
            "apart_nats": rival.fit.cost - limb.chosen.fit.cost,
        }
        for rival in limb.tied
    ]
