"""The diagnosis of a log: where the gap lies, which effect causes it, how far it shrinks."""

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np

from backends.effect import UNITS, Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.evidence import Evidence, gather
from diagnosis.attribution.experiments import Trials, tie, told_of
from diagnosis.attribution.locate import Place, locate
from diagnosis.attribution.magnitudes import Magnitude, magnitudes, merge
from diagnosis.attribution.verdict import NONE, UNKNOWN, LimbVerdict, judge, rules
from diagnosis.logs.log import Log, LogError
from diagnosis.recording.excitation import FREE
from diagnosis.triage.triage import refuse_bugs

BLOCK, RESAMPLES = 50, 400
"""Samples that are resampled together, and how often, for intervals over held-out samples."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share, or a gap, with its 90 % interval."""

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
    unseen: tuple[str, ...]
    """Joints of which this log tells nothing."""
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
    gaps: Mapping[str, Share]
    """The gaps before, nominal and after with their intervals."""
    cpu_s: float
    """Of this process and those that it waited for [s]."""
    limbs: tuple[LimbVerdict, ...] = field(repr=False)
    """The verdicts behind, per limb, with everything that was fitted."""

    def row(self) -> dict:
        """As plain data, without the fits."""
        said = {name: getattr(self, name) for name in self.__dataclass_fields__ if name != "limbs"}
        return said | {
            "verdict": list(self.verdict),
            "joints": list(self.joints),
            "unseen": list(self.unseen),
            "magnitudes": [asdict(m) for m in self.magnitudes],
            "where": [place.row() for place in self.where],
            "shrinkage": asdict(self.shrinkage),
            "shrinkage_nominal": asdict(self.shrinkage_nominal),
            "gaps": {name: asdict(gap) for name, gap in self.gaps.items()},
        }


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One limb's verdict, and what its evidence cannot tell from it."""

    verdict: LimbVerdict
    ties: tuple[dict, ...]


Judge = Callable[[Evidence], Judged]
SideBySide = Callable[[Judge, Sequence[Evidence]], Iterable[Judged]]
"""Like `map`, maybe on several cores: the judge of each limb in order."""


def diagnose(
    log: Log,
    nominal: Spec,
    catalogue: Mapping[str, type[Effect]],
    side_by_side: SideBySide = map,
) -> Diagnosis:
    """The diagnosis of `log` against the nominal world; limbs are judged by `side_by_side`.

    Raises LogError where nothing can be said.
    """
    began_s = _cpu_s()
    rule = rules()
    floor = {
        "position": rule.floor_position_rad,
        "motor": rule.floor_position_rad,
        "torque": rule.floor_torque_share,
    }
    parts = gather(log, nominal, floor)
    refuse_bugs(parts)
    told = [told_of(part, catalogue) for part in parts]
    if not any(told):
        raise LogError(
            "not identifiable from this log: no joint moves or is pushed enough to show a change "
            f"of any nominal parameter; record {', '.join(FREE)}"
        )
    uncertainty = log.meta.nominal_uncertainty
    judge_one = partial(judge_limb, catalogue=catalogue, uncertainty=uncertainty)
    clear = [part for part, joints in zip(parts, told, strict=True) if joints]
    limbs = list(side_by_side(judge_one, clear))
    seen = {joint for joints in told for joint in joints}
    unseen = tuple(joint for part in parts for joint in part.joints if joint not in seen)
    return _assemble(parts, limbs, unseen, began_s)


def judge_limb(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> Judged:
    """The verdict on one limb and its ties, each with the experiment that would break it."""
    limb = judge(evidence, catalogue, uncertainty)
    trials = Trials(limb) if limb.tied else None
    ties = tuple(tie(limb, rival, trials) for rival in limb.tied if trials is not None)
    return Judged(verdict=limb, ties=ties)


def _cpu_s() -> float:
    """CPU time of this process and of the children it has waited for [s]."""
    return sum(os.times()[:4])


def _assemble(
    parts: Sequence[Evidence],
    judged: Sequence[Judged],
    unseen: tuple[str, ...],
    began_s: float,
) -> Diagnosis:
    limbs = [one.verdict for one in judged]
    guilty = [limb for limb in limbs if limb.names not in ((NONE,), (UNKNOWN,))]
    found = merge([m for limb in guilty for m in magnitudes(limb)])
    unknown = [limb for limb in limbs if limb.names == (UNKNOWN,)]
    verdict = tuple(dict.fromkeys(m.effect for m in found))
    verdict += (UNKNOWN,) if unknown else ()
    before, nominal, after = (
        np.concatenate([of(limb) for limb in limbs])
        for of in (
            lambda limb: limb.attribution.before.plain,
            lambda limb: limb.attribution.nominal.plain,
            lambda limb: limb.chosen.plain,
        )
    )
    gaps = {"before": gap(before), "nominal": gap(nominal), "after": gap(after)}
    accused = {joint for m in found for joint in m.joints}
    strange = {joint for limb in unknown for joint in _worst(limb)}
    return Diagnosis(
        verdict=verdict or (NONE,),
        joints=tuple(j for p in parts for j in p.joints if j in accused | strange),
        magnitudes=found,
        confidence=math.prod(limb.confidence for limb in (guilty or limbs)),
        ranking=tuple(row for limb in limbs for row in _ranking(limb)),
        indistinguishable=tuple(row for one in judged for row in one.ties),
        unseen=unseen,
        where=tuple(locate(parts)),
        gap_before=gaps["before"].value,
        gap_nominal=gaps["nominal"].value,
        gap_after=gaps["after"].value,
        noise_floor=1.0,
        shrinkage=shrinkage(before, after),
        shrinkage_nominal=shrinkage(before, nominal),
        gaps=gaps,
        cpu_s=_cpu_s() - began_s,
        limbs=tuple(limbs),
    )


def shrinkage(before: Array, after: Array, seed: int = 0) -> Share:
    """How much of the squared gap above the noise is gone, from squared held-out residuals."""
    return _resampled(_gone, (before, after), seed)


def gap(squares: Array, seed: int = 0) -> Share:
    """Root mean square over the noise, from squared held-out residuals."""
    return _resampled(np.sqrt, (squares,), seed)


def _resampled(of: Callable[..., float], squares: tuple[Array, ...], seed: int) -> Share:
    """A function of the means of squares, with the interval that resampled blocks give."""
    size = min(BLOCK, len(squares[0]))
    count = len(squares[0]) // size
    blocks = [v[: count * size].reshape(count, size).mean(axis=1) for v in squares]
    draws = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    resampled = [of(*(b[d].mean() for b in blocks)) for d in draws]
    low, high = np.percentile(resampled, [5, 95])
    value = of(*(v.mean() for v in squares))
    return Share(value=float(value), interval=(float(low), float(high)))


def _gone(before: float, after: float) -> float:
    excess = before - 1.0
    return float(1 - max(after - 1.0, 0.0) / excess) if excess > 1e-9 else 0.0


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
