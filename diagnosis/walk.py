"""The walk of a diagnosis: the log, its free-air motion, the stick in the hand, one answer."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from math import prod

import numpy as np

from backends.catalogue import Catalogue
from backends.catalogue import catalogue as every_effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.answer import Diagnosis
from diagnosis.evidence.evidence import by_second
from diagnosis.logs.log import Log, MjcfMechanism
from diagnosis.motion.along import turned
from diagnosis.motion.batch import Simulate
from diagnosis.motion.columns import by_name, with_numbers
from diagnosis.plain_gap import plain_gap
from diagnosis.progress import Progress, Stop, forward, within
from diagnosis.replay.agreement import engine_gaps_rad
from diagnosis.replay.nominal import mjcf_world
from diagnosis.shrinkage import gaps_and_shares, held_out
from diagnosis.signals import NOMINAL, Signals, signals
from diagnosis.solver import Judged, judged
from diagnosis.triage.triage import triage
from diagnosis.verdict import probability
from diagnosis.verdict.ordinary import Ordinary
from diagnosis.verdict.result import NONE, UNKNOWN, LimbResult, Report, decisive, named, verdict
from diagnosis.verdict.sensors import not_looked_for
from diagnosis.where import Place, largest, locate
from files.tables import give_back

FIRST = "checking the log; the first diagnosis after installing compiles for some 15 s"
STOPPED = "Stopped before its end; this is what the fits so far say:"
CHECKED, JUDGED = 0.15, 0.9
"""Shares of the work that are done when the log is checked, and when all joints are judged."""


def diagnose(
    log: Log,
    healthy: Sequence[Log] = (),
    *,
    nominal: Spec | None = None,
    catalogue: Catalogue | None = None,
    origin: Ordinary | None = None,
    simulate: Simulate | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """What is wrong with the mechanism of a log; raises LogError where the log cannot say.

    `healthy`: logs of the same mechanism while nothing was wrong. `nominal`: what the mechanism
    should be; needed of a hand known by name. `catalogue`: effects to look for, all by default.
    `origin`: what is ordinary. `simulate` puts worlds on the nominal engine;
    without it stick and contact are left out.
    `progress` is called with what is being done, and the share done; where it raises Stop, what is
    known so far is the answer.
    """
    began_s = sum(os.times()[:4])  # with the children it has waited for
    known = every_effect() if catalogue is None else catalogue
    world, tell = nominal or mjcf_world(log), forward(progress or (lambda text, share: None))
    tell(FIRST, 0.0)
    remarks, *_ = [triage(one, world) for one in (log, *healthy)]
    give_back()
    limbs, notes = judged(log, healthy, world, known, origin, within(tell, CHECKED, JUDGED))
    give_back()
    stopped = limbs[-1].stopped
    try:
        tell("touch and stick" if log.fingers else "the gap, by place and time", JUDGED)
    except Stop:
        stopped = True
    said = tuple(one.result for one in limbs)
    numbers = dict(_corrected(limbs))
    gravity = _gravity(limbs, world)
    corrected = with_numbers(world, numbers, gravity)
    there, engine = corrected, tuple[float, ...]()
    if simulate and not isinstance(log.meta.mechanism, MjcfMechanism):
        try:
            engine = engine_gaps_rad(simulate, (world, corrected), log)
        except ValueError as error:  # of a load that it cannot hold where the fit has it
            notes.append(f"the engine cannot hold the corrected world: {error}")
            there = world
    held = Report()
    if world.hand.fingertips and not stopped:
        from diagnosis.grasp.in_hand import in_hand  # takes its time to load

        held = in_hand(log, there, known, simulate)
    causes = (*named(said), *(one for one in held.causes if one.effect != UNKNOWN))
    accused = {joint for cause in causes for joint in cause.joints}
    if verdict(said) == (UNKNOWN,):
        by_joint = max(said, key=lambda limb: limb.gap_nominal).gaps
        accused.add(max(by_joint, key=by_joint.__getitem__))
    worst = max(decisive(said), key=lambda limb: limb.gap_nominal / limb.ordinary)
    gaps, gone, gone_nominal = gaps_and_shares([_by_second(one) for one in limbs])
    plain = None
    if isinstance(log.meta.mechanism, MjcfMechanism):
        rested = [joint for one in said for joint in one.rested or ()]
        plain = plain_gap(log, world, corrected, [one.evidence for one in limbs], rested)
        engine = plain.before_rad, plain.after_rad
    with suppress(Stop):
        tell("done", 1.0)
    places = tuple(locate([one.nominal for one in limbs]))
    return Diagnosis(
        verdict=verdict(said, held.causes),
        joints=tuple(j for one in limbs for j in one.evidence.joints if j in accused),
        magnitudes=causes,
        probability=_probability(said, held),
        sentences=(*([STOPPED] if stopped else []), *_sentences(said, held, places)),
        share=worst.share,
        left=max(limb.left for limb in said),
        ordinary=worst.ordinary,
        ordinary_from=worst.ordinary_from,
        gaps=gaps,
        engine_gaps_rad=engine,
        in_mujoco=plain,
        shrinkage=gone,
        shrinkage_nominal=gone_nominal,
        where=places,
        corrected=numbers,
        gravity_m_s2=gravity,
        limbs=said,
        spots=held.spots,
        missing=(*not_looked_for(known), *held.missing),
        notes=(*remarks, *notes),
        stopped=stopped,
        signals=tuple(_signals(limbs, accused or {places[0].joint})),
        cpu_s=sum(os.times()[:4]) - began_s,
    )


def _corrected(limbs: Sequence[Judged]) -> Iterator[tuple[str, dict[str, float]]]:
    """See `Diagnosis.corrected`, joint by joint."""
    for one in (limb for limb in limbs if limb.result.verdict != (UNKNOWN,)):
        if one.result.rested is not None:
            yield from one.result.rested.items()
            continue
        fit = one.found.chosen if one.result.causes else one.found.nominal
        numbers, _ = one.fitter.numbers(one.fitter.seen(fit))
        rows = zip(one.evidence.joints, numbers, one.evidence.limb.nominal, strict=True)
        for joint, row, nominal in rows:
            yield joint, dict(by_name(row).items() - by_name(nominal).items())


def _gravity(limbs: Sequence[Judged], nominal: Spec) -> tuple[float, float, float] | None:
    """See `Diagnosis.gravity_m_s2`: of the limb that turns it most."""
    known = [one for one in limbs if one.result.causes and one.result.verdict != (UNKNOWN,)]
    tilts = [one.fitter.numbers(one.found.chosen.u)[1] for one in known]
    most = max(tilts, key=lambda tilt: float(np.abs(tilt).max()), default=None)
    if most is None or not most.any():
        return None
    x, y, z = map(float, turned(nominal.gravity_m_s2, most))
    return x, y, z


def _probability(limbs: Sequence[LimbResult], held: Report) -> float:
    """That all that is named is right; of an unknown gap, that no effect explains it."""
    found = prod(probability.in_hand(one) for one in held.causes)
    if held.causes and verdict(limbs) == (NONE,):
        return found
    strange = [limb for limb in decisive(limbs) if limb.verdict == (UNKNOWN,)]
    return found * prod(limb.probability for limb in strange or decisive(limbs))


def _sentences(limbs: Sequence[LimbResult], held: Report, places: Sequence[Place]) -> Iterator[str]:
    """Of limbs at fault, the decisive first; of one where none is; then what the grasp shows."""
    first = decisive(limbs)
    faulty = [limb for limb in limbs if limb.verdict != (NONE,) or limb.sensors]
    shown = sorted(faulty, key=lambda limb: limb not in first) or (
        [] if held.causes else [max(limbs, key=lambda limb: limb.left)]
    )
    for limb in shown:
        where = f"{', '.join(limb.joints)}: " if len(shown) > 1 else ""
        yield from (where + one for one in limb.sentences[:1])
        yield from limb.sentences[1:]
        if limb.verdict == (UNKNOWN,):
            yield largest(places, limb.joints)
    for one in held.causes:
        yield f"{one.effect}: {one.evidence}."


def _by_second(one: Judged) -> tuple[Array, Array, Array]:
    """What a limb's nominal world, its refitted numbers and its causes leave, by second."""
    found, evidence = one.found, one.fitter.evidence
    bare = one.evidence.readings - one.nominal.shown({})
    lefts = (held_out(one.fitter, fit) for fit in (found.nominal, found.chosen))
    nominal, after = (by_second(evidence, left) for left in lefts)
    return by_second(one.evidence, bare), nominal, after


def _signals(limbs: Sequence[Judged], joints: set[str]) -> Iterator[Signals]:
    for one in limbs:
        world, found = one.fitter, one.found
        worlds = {NOMINAL: (one.nominal, {}), "nominal numbers refitted": (world, found.nominal.u)}
        if found.chosen.freed:
            worlds["with the causes"] = (world, found.chosen.u)
        for j, joint in enumerate(one.evidence.joints):
            if joint in joints:
                yield signals(one.evidence, worlds, j)
