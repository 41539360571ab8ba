"""The diagnosis of a log: where the gap lies, which effect causes it, how far it shrinks."""

import dataclasses
import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import compress
from typing import TypeVar

import numpy as np

from backends.effect import UNITS, Effect, with_effects
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.conditions import join
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.experiments import Trials, tie, told_of
from diagnosis.attribution.gather import gather
from diagnosis.attribution.locate import locate
from diagnosis.attribution.magnitudes import Magnitude, magnitudes, merge
from diagnosis.attribution.rules import rules
from diagnosis.attribution.sound import Sound, worst
from diagnosis.attribution.verdict import (
    NONE,
    UNKNOWN,
    LimbVerdict,
    judge,
    leaves,
    most_of,
    unaccused,
)
from diagnosis.beside.beside import (
    corrected,
    lost,
    magnitude,
    outdone,
    ranking_of,
    sensed,
    told_apart,
)
from diagnosis.beside.fingerprints import widened
from diagnosis.beside.lost_motion import plays
from diagnosis.beside.slow import at_rest, unjudged
from diagnosis.calibration.worlds import Simulate
from diagnosis.finding import Finding, Report
from diagnosis.grasp.in_hand import in_hand
from diagnosis.leading import leading
from diagnosis.logs.log import Log, LogError
from diagnosis.recording.excitation import FREE
from diagnosis.result import Diagnosis
from diagnosis.shrinkage import gap, shrinkage
from diagnosis.triage.triage import triage

E = TypeVar("E", bound=Evidence)
ALONE = "lost packets, touch, stick and contact: diagnose each log by itself"
"""What several settings leave out."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One limb's verdict, the effects that it names, and what cannot be distinguished from it."""

    verdict: LimbVerdict
    found: tuple[Magnitude, ...]
    ties: tuple[dict, ...]
    sound: Sound | None = None
    """What it leaves where nothing is wrong, see `healthy`."""


Judge = Callable[[Evidence], Judged]
SideBySide = Callable[[Judge, Sequence[Evidence]], Iterable[Judged]]
"""Like `map`, maybe on several cores: the judge of each limb in order."""


def diagnose(
    log: Log,
    nominal: Spec,
    catalogue: Mapping[str, type[Effect]],
    side_by_side: SideBySide = map,
    simulate: Simulate | None = None,
    sound: Sequence[Sound] = (),
) -> Diagnosis:
    """The diagnosis of `log` against the nominal world; limbs are judged by `side_by_side`.

    Stick and contact are judged where `simulate` puts worlds on the nominal engine. The residuals
    of healthy logs are given by `healthy`. Raises LogError where nothing can be said.
    """
    began_s = _cpu_s()
    whole, found = _gathered(log, nominal, catalogue)
    whole = _excusing(whole, sound)
    told, unseen = _told(whole, catalogue, found)
    parts = tuple(map(at_rest, whole))
    clear = list(compress(parts, told))
    uncertainty = log.meta.nominal_uncertainty
    settled = frozenset(
        joint for one in found if getattr(one, "instead", False) for joint in one.joints
    )
    judge_one = partial(judge_limb, catalogue=catalogue, uncertainty=uncertainty, settled=settled)
    limbs = list(side_by_side(judge_one, clear))
    losses, heard = lost(clear, [one.verdict for one in limbs], catalogue)
    limbs = _anew(limbs, clear, heard, partial(side_by_side, judge_one))
    before = (*found, *losses)
    kept = [one for one in limbs if outdone(one.verdict, before) is None]
    world = corrected(_with(nominal, kept, catalogue), found, catalogue)
    held = in_hand(log, world, catalogue, simulate)
    others = dataclasses.replace(
        held,
        findings=(*before, *held.findings),
        missing=(*unjudged(parts), *held.missing),
    )
    return _assemble(parts, limbs, others, catalogue, unseen, began_s)


def _anew(
    limbs: Sequence[Judged],
    told: Sequence[Evidence],
    heard: Sequence[Evidence],
    judged: Callable[[Sequence[Evidence]], Iterable[Judged]],
) -> list[Judged]:
    """Limbs that did not hear all that they were told, judged by what they heard.

    Which packets were lost is not known for sure: what is left beside them is not called unknown,
    an effect that takes most of it is named, and any must lead by `firm_nats`.
    """
    pairs = list(zip(told, heard, strict=True))
    again = iter(judged([right for wrong, right in pairs if wrong is not right]))
    return [
        one if wrong is right else _heard(next(again), one)
        for one, (wrong, right) in zip(limbs, pairs, strict=True)
    ]


def _heard(again: Judged, first: Judged) -> Judged:
    """A limb's verdict beside lost packets."""
    if again.verdict.names == (UNKNOWN,) and (most := most_of(again.verdict)) is not None:
        again = Judged(verdict=most, found=tuple(magnitudes(most)), ties=())
    limb = again.verdict
    if limb.names == (UNKNOWN,) or limb.gain_nats < limb.attribution.rule.firm_nats:
        again = Judged(verdict=_nominal(limb), found=(), ties=())
    return dataclasses.replace(
        again, verdict=dataclasses.replace(again.verdict, told=first.verdict)
    )


def diagnose_settings(
    settings: Sequence[tuple[Log, Spec]],
    judging: Collection[int],
    catalogue: Mapping[str, type[Effect]],
    side_by_side: SideBySide = map,
    sound: Sequence[Sound] = (),
) -> Diagnosis:
    """The diagnosis of one mechanism's logs under several settings, each with its nominal world.

    Limbs are fitted on some logs and judged on those numbered in `judging`. Lost packets, touch,
    stick and contact are a matter of one log. Healthy logs are as in `diagnose`. Raises LogError
    where nothing can be said.
    """
    began_s = _cpu_s()
    logs = [_gathered(log, nominal, catalogue) for log, nominal in settings]
    if len({tuple(part.joints for part in parts) for parts, _ in logs}) > 1:
        raise LogError("these logs are of different joints; give logs of one mechanism")
    rests = [tuple(map(at_rest, parts)) for parts, _ in logs]
    joined = [join(limb, judging) for limb in zip(*rests, strict=True)]
    parts = _excusing(joined, sound)
    told, unseen = _told(parts, catalogue, [one for _, seen in logs for one in seen])
    clear = list(compress(parts, told))
    uncertainty = max(log.meta.nominal_uncertainty for log, _ in settings)
    judge_one = partial(judge_limb, catalogue=catalogue, uncertainty=uncertainty)
    limbs = list(side_by_side(judge_one, clear))
    slow = [text for setting, _ in logs for text in unjudged(setting)]
    others = Report(findings=logs[min(judging)][1], missing=(*dict.fromkeys(slow), ALONE))
    return _assemble(parts, limbs, others, catalogue, unseen, began_s)


def healthy(
    logs: Sequence[tuple[Log, Spec]],
    catalogue: Mapping[str, type[Effect]],
    side_by_side: SideBySide = map,
) -> tuple[Sound, ...]:
    """What every limb of a mechanism leaves in logs of it, with their nominal worlds, while sound.

    The most in any of them. Nothing is judged: what these logs show is called sound. Raises
    LogError where one cannot be used or leaves too much for that, or the logs are of different
    joints.
    """
    gathered = []
    for number, pair in enumerate(logs, start=1):
        try:
            gathered.append(tuple(map(at_rest, _gathered(*pair, catalogue)[0])))
        except LogError as error:
            raise LogError(f"healthy log {number} of {len(logs)}: {error}") from error
    if len({tuple(part.joints for part in parts) for parts in gathered}) > 1:
        raise LogError("the healthy logs are of different joints; give logs of one mechanism")
    uncertainty = max(log.meta.nominal_uncertainty for log, _ in logs)
    judge_one = partial(_sound_limb, catalogue=catalogue, uncertainty=uncertainty)
    every = [part for parts in gathered for part in parts]
    limbs, found = len(gathered[0]), list(side_by_side(judge_one, every))
    for k, one in enumerate(found):
        gap_there = one.verdict.attribution.nominal.gap
        if gap_there > rules().sound_gap:
            raise LogError(
                f"healthy log {k // limbs + 1} of {len(logs)} leaves {gap_there:.1f} times the "
                f"noise floor on {', '.join(every[k].joints)} with the nominal parameters "
                f"refitted; allowed: up to {rules().sound_gap:g}. What excuses that excuses "
                "any effect: diagnose that log first, and name what it finds with --known-effects"
            )
    sounds = [one.sound or Sound() for one in found]
    return tuple(worst(sounds[k::limbs]) for k in range(limbs))


def _sound_limb(
    evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
) -> Judged:
    limb, left = leaves(evidence, catalogue, uncertainty)
    return Judged(verdict=limb, found=(), ties=(), sound=left)


def _excusing(parts: Sequence[E], left: Sequence[Sound]) -> tuple[E, ...]:
    """The evidence for every limb, with what it leaves while sound."""
    if not left:
        return tuple(parts)
    if len(left) != len(parts):
        raise LogError("the healthy logs are of other joints; give logs of the same mechanism")
    pairs = zip(parts, left, strict=True)
    return tuple(dataclasses.replace(part, sound=one) for part, one in pairs)


def _gathered(
    log: Log, nominal: Spec, catalogue: Mapping[str, type[Effect]]
) -> tuple[tuple[Evidence, ...], tuple[Finding, ...]]:
    """The evidence for every limb, and what its sensors and rests tell that replays do not."""
    parts = gather(log, nominal, rules().floor)
    triage(log, nominal)
    sensors = sensed(parts, catalogue)
    seen = tuple(widened(part, sensors) for part in parts)
    found = plays(seen, catalogue, log.meta.nominal_uncertainty)
    return seen, (*sensors, *found)


def _told(
    parts: Sequence[Evidence], catalogue: Mapping[str, type[Effect]], found: Sequence[Finding]
) -> tuple[list[bool], tuple[str, ...]]:
    """Which limbs the samples tell anything of, and all joints of which they do not.

    LogError where they tell of none; it says what the sensors show all the same.
    """
    told = [told_of(part, catalogue) for part in parts]
    if not any(told):
        shown = [f"; {one.effect} of {', '.join(one.joints)}: {one.evidence}" for one in found]
        raise LogError(
            "not identifiable from this log: no joint moves or is pushed enough to show a change "
            f"of any nominal parameter{''.join(shown)}; record {', '.join(FREE)}"
        )
    seen = {joint for joints in told for joint in joints}
    unseen = tuple(joint for part in parts for joint in part.joints if joint not in seen)
    return list(map(bool, told)), unseen


def _with(nominal: Spec, limbs: Sequence[Judged], catalogue: Mapping[str, type[Effect]]) -> Spec:
    """The nominal world, its parameters as replays refitted them, with what they found."""
    verdicts = [limb.verdict for limb in limbs if limb.verdict.names != (UNKNOWN,)]
    refitted = [one for verdict in verdicts for one in verdict.refitted]
    named = [one for m in _found(limbs) for one in _effects(m, catalogue)]
    return with_effects(nominal, (*refitted, *named))


def _effects(found: Magnitude, catalogue: Mapping[str, type[Effect]]) -> Iterator[Effect]:
    """What was found as effects, one per joint where it acts on joints."""
    kind, size = catalogue[found.effect], found.value * UNITS[found.unit][1]
    everywhere = found.joint is None and not kind.per_joint
    for joint in (None,) if everywhere else found.joints:
        yield kind(magnitude=size, joint=joint)


def _found(limbs: Sequence[Judged]) -> tuple[Magnitude, ...]:
    return merge([m for limb in limbs for m in limb.found])


def judge_limb(
    evidence: Evidence,
    catalogue: Mapping[str, type[Effect]],
    uncertainty: float,
    settled: Collection[str] = (),
) -> Judged:
    """The verdict on one limb and its ties, each with the experiment that would break it.

    Where a joint is settled by other evidence, only the nominal parameters are refitted.
    """
    known = {} if set(settled) & set(evidence.joints) else catalogue
    limb = judge(evidence, known, uncertainty)
    found = () if limb.names in ((NONE,), (UNKNOWN,)) else tuple(magnitudes(limb))
    if len(found) == 1 and found[0].interval[0] <= 0.0 <= found[0].interval[1]:
        limb, found = unaccused(limb), ()
    trials = Trials(limb) if limb.tied else None
    ties = tuple(tie(limb, rival, trials) for rival in limb.tied if trials is not None)
    return Judged(verdict=limb, found=found, ties=ties)


def _cpu_s() -> float:
    """CPU time of this process and of the children it has waited for [s]."""
    return sum(os.times()[:4])


def _assemble(
    parts: Sequence[Evidence],
    judged: Sequence[Judged],
    others: Report,
    catalogue: Mapping[str, type[Effect]],
    unseen: tuple[str, ...],
    began_s: float,
) -> Diagnosis:
    kept = [one for one in judged if outdone(one.verdict, others.findings) is None]
    limbs = [one.verdict for one in kept]
    named = [magnitude(one, catalogue) for one in others.findings]
    found = (*_found(kept), *(m for m in named if m is not None))
    strange = [joint for limb in limbs if limb.names == (UNKNOWN,) for joint in _worst(limb)]
    verdict = tuple(dict.fromkeys(m.effect for m in found))
    verdict += (UNKNOWN,) if strange or None in named else ()
    accused = {*strange, *(joint for m in found for joint in m.joints)}
    accused |= {joint for f in others.findings if f.effect == UNKNOWN for joint in f.joints}
    before, nominal, after = _squares(judged, others.findings)
    gaps = {"before": gap(before), "nominal": gap(nominal), "after": gap(after)}
    return Diagnosis(
        verdict=verdict or (NONE,),
        joints=tuple(j for p in parts for j in p.joints if j in accused),
        magnitudes=found,
        confidence=_confidence(limbs, others.findings),
        ranking=(
            *(row for one in others.findings for row in ranking_of(one, catalogue)),
            *(_row(one.verdict, tried) for one in judged for tried in one.verdict.ranking),
        ),
        indistinguishable=(
            *(row for one in kept for row in one.ties),
            *(row for one in others.findings for row in told_apart(one)),
        ),
        leading=leading(limbs),
        unseen=unseen,
        where=tuple(locate(parts)),
        gap_before=gaps["before"].value,
        gap_nominal=gaps["nominal"].value,
        gap_after=gaps["after"].value,
        noise_floor=1.0,
        shrinkage=shrinkage(before, after),
        shrinkage_nominal=shrinkage(before, nominal),
        gaps=gaps,
        beside=others.findings,
        spots=others.spots,
        missing=others.missing,
        cpu_s=_cpu_s() - began_s,
        limbs=tuple(_cleared(one.verdict, others.findings) for one in judged),
    )


def _cleared(limb: LimbVerdict, found: Sequence[Finding]) -> LimbVerdict:
    """A limb's verdict, `none` where a finding takes its place."""
    return limb if outdone(limb, found) is None else _nominal(limb)


def _nominal(limb: LimbVerdict) -> LimbVerdict:
    return dataclasses.replace(limb, names=(NONE,), chosen=limb.attribution.nominal, tied=())


def _squares(judged: Sequence[Judged], found: Sequence[Finding]) -> list[Array]:
    """Squared held-out residuals of all limbs: nominal, refitted, and with the verdict.

    Where a finding takes a limb's place, it shrinks them as it shrinks what it was judged by.
    """
    before, nominal, after = [], [], []
    for one in judged:
        told = one.verdict.told or one.verdict
        before.append(told.attribution.before.plain)
        nominal.append(told.attribution.nominal.plain)
        other = outdone(one.verdict, found)
        shrunk = None if other is None else (other.gap_after / other.gap_before) ** 2
        after.append(one.verdict.chosen.plain if shrunk is None else shrunk * before[-1])
    return [np.concatenate(v) for v in (before, nominal, after)]


def _confidence(limbs: Sequence[LimbVerdict], found: Sequence[Finding]) -> float:
    """That all accusations are right; else of the surest unknown, or of the least sure none.

    Limbs accused alike are right or wrong together.
    """
    guilty: dict[tuple[str, ...], float] = {}
    for limb in limbs:
        if limb.names not in ((NONE,), (UNKNOWN,)):
            guilty[limb.names] = min(limb.confidence, guilty.get(limb.names, 1.0))
    if accused := [*guilty.values(), *(one.confidence for one in found)]:
        return math.prod(accused)
    strange = [limb.confidence for limb in limbs if limb.names == (UNKNOWN,)]
    return max(strange) if strange else min(limb.confidence for limb in limbs)


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
