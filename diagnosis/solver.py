"""Which unmodelled effects explain a log: for every limb, its tolerances first, then the search.

What a sound robot would leave decides, see `verdict.ordinary`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.catalogue import Catalogue
from backends.spec import Spec
from diagnosis.evidence.evidence import Evidence, evidence, squared_gaps
from diagnosis.evidence.log_faults import StillError, checked
from diagnosis.logs.log import Log, MjcfMechanism
from diagnosis.models.loops import terms
from diagnosis.models.parameters import Parameter, parameters
from diagnosis.models.world import World
from diagnosis.motion.columns import PLAY
from diagnosis.motion.excerpt import FITTED_S, SEARCHED_S, excerpt, excerpted
from diagnosis.motion.limb import Limb
from diagnosis.packets.losses import BY_CHANCE, Losses, arrived, losses
from diagnosis.packets.rounding import Rounding, roundings
from diagnosis.progress import Progress, Stop, within
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import with_own_steps
from diagnosis.replay.robot import uncertainties
from diagnosis.search.chaos import spreading
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.healthy import centred, healthy_fit
from diagnosis.search.search import QUIET, Found, Search
from diagnosis.search.whole import on_whole
from diagnosis.verdict.decide import decide
from diagnosis.verdict.lost_motion import with_play
from diagnosis.verdict.ordinary import (
    FURTHER,
    ROBOTS,
    SHAPE,
    SHAPE_LEFT,
    SIMULATORS,
    Ordinary,
    doubts,
    of_healthy,
    share_of,
)
from diagnosis.verdict.result import LimbResult
from diagnosis.verdict.sensors import LOSS, STEP, sensor_cause, sensor_causes
from diagnosis.verdict.sentences import sentences

TURNS = 3
"""Decodings of lost packets, each with the fit to the one before."""
SEARCHED, FITTED = 0.6, 0.9
"""Shares of a limb's work that are done after the search, and after the fits to the whole log."""
RESTS = "rows are {:.0f} ms apart, so only rests are judged; record one every 50 ms or faster"
LONG = "fitted to the {:.0f} s of {:.0f} s that say most"
SHORTER = 0.99
"""A part is shorter than the whole by more than what episodes too short to use last."""
LEAST_UNCERTAINTY = 1e-3
"""No nominal number is known better."""


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What a log is judged by."""

    rigid: bool
    uncertainty: float
    catalogue: Catalogue
    origin: Ordinary
    guesses: Mapping[tuple[str, str], float]
    """Of nominal numbers that are hardly known, see `replay.robot.uncertainties`."""

    def parameters(self, said: Evidence) -> tuple[Parameter, ...]:
        """What may be off or wrong of a limb, and what its drives may do otherwise."""
        known = self.uncertainty, self.origin.everyday, self.guesses
        found = parameters(self.catalogue, said, *known)
        return (*found, *terms(said, len(found)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """What is said of a limb, and the fits that it rests on."""

    result: LimbResult
    nominal: World
    """The nominal world as it stands, without parameters."""
    fitter: Fitter
    found: Found

    @property
    def stopped(self) -> bool:
        """Whether it, or a limb after it, could not be searched to the end."""
        return self.found.stopped

    @property
    def evidence(self) -> Evidence:
        """As recorded: that of the fits has the commands that arrived, where packets were lost."""
        return self.nominal.evidence


def judged(
    log: Log,
    healthy: Sequence[Log],
    nominal: Spec,
    catalogue: Catalogue,
    origin: Ordinary | None,
    progress: Progress,
) -> tuple[list[Judged], list[str]]:
    """All limbs of a log's mechanism, and notes on the log; arguments are those of `diagnose`.

    Raises LogError where the log cannot say. The last limb is `stopped` where `progress` raises
    Stop, which is raised where nothing is known.
    """
    rigid = isinstance(log.meta.mechanism, MjcfMechanism)
    asked = Asked(
        rigid=rigid,
        uncertainty=max(log.meta.nominal_uncertainty, LEAST_UNCERTAINTY),
        catalogue=catalogue,
        origin=origin or (ROBOTS if rigid else SIMULATORS),
        guesses=uncertainties(log),
    )
    progress("reading the log", 0.0)
    parts = limbs(nominal)
    found, notes, still = list[Judged](), list[str](), list[StillError]()
    for number, part in enumerate(parts):
        share = within(progress, number / len(parts), (number + 1) / len(parts))
        try:
            said, more = _evidence(part, log, asked)
        except StillError as error:
            still.append(error)
            names = ", ".join(part.hand.joint_names)
            notes.append(f"this log shows nothing of {names}: their targets stand still")
            continue
        fine = [_part(_evidence(part, h, asked)[0]) for h in healthy]
        sound = [healthy_fit(one, asked.parameters(one), asked.origin) for one in fine]
        more = (*more, *doubts([fit.worst for fit in sound], asked.origin))
        try:
            found.append(_limb(said, sound, asked, share))
        except Stop:
            if not found:
                raise
            last = found[-1]
            found[-1] = replace(last, found=replace(last.found, stopped=True))
        notes.extend(more)
        if found[-1].stopped:
            break
    if not found:
        raise still[0]
    return found, notes


def _limb(said: Evidence, sound: Sequence[Fit], asked: Asked, progress: Progress) -> Judged:
    """What is said of a limb; `sound`: fits of healthy logs."""
    known, ordinary = asked.parameters(said), asked.origin
    if sound:
        ordinary = of_healthy([fit.worst for fit in sound], asked.origin)
        known = centred(known, sound, asked.uncertainty)
    fitter, found = _searched(said, known, ordinary, progress)
    if found.stopped:
        return _judged(decide(fitter, found, ordinary), fitter.evidence, fitter, found)
    left = found.chosen.residual
    sensors = list(sensor_causes(said, left, ordinary, asked.catalogue))
    received = said
    for one in _rounded(fitter, found.chosen):
        sensors.append(sensor_cause(said, STEP, (one.joint,), one.sizes, asked.catalogue))
        if sensors[-1].effect in asked.catalogue:
            received = replace(received, limb=received.limb.with_steps(one.joint, one.sizes[0]))
    if received is not said:
        fitter, found = _searched(received, known, ordinary, progress)
    lost, explained = _lost(fitter, found.chosen, ordinary), 0.0
    if lost:
        received = replace(received, limb=arrived(received.limb, lost))
        joints = np.flatnonzero(lost.groups.any(axis=0)).tolist()
        sensors.append(sensor_cause(said, LOSS, joints, lost.sizes, asked.catalogue))
        if sensors[-1].effect in asked.catalogue:
            explained = found.chosen.worst
            fitter, found = _searched(received, known, ordinary, progress)
    result = decide(fitter, found, ordinary, sensors, explained)
    result = with_play(result, said, asked.catalogue, asked.uncertainty)
    return _judged(result, said, fitter, found)


def _judged(result: LimbResult, said: Evidence, fitter: Fitter, found: Found) -> Judged:
    result = replace(result, sentences=tuple(sentences(result)))
    return Judged(result=result, nominal=World(said), fitter=fitter, found=found)


def _searched(
    said: Evidence, known: Sequence[Parameter], ordinary: Ordinary, progress: Progress
) -> tuple[Fitter, Found]:
    """What a search finds, on a part of a long log, then fitted to all of it."""
    part = _part(said)
    fitter = Fitter(part, known)
    found = Search(fitter, ordinary, within(progress, 0.0, SEARCHED)).run().lean()
    try:
        if part is not said and not found.stopped:
            whole = Fitter(said, known)
            found = on_whole(whole, found, ordinary, within(progress, SEARCHED, FITTED)).lean()
            fitter = whole
        progress("what is left", FITTED)
    except Stop:
        found = replace(found, stopped=True)
    return fitter, found


def _part(said: Evidence) -> Evidence:
    """The evidence, or that of a part that is long enough to search on."""
    limb = said.limb
    some = excerpt(limb.recordings, SEARCHED_S)
    if some == limb.recordings:
        return said
    return spreading(World(evidence(replace(limb, recordings=some))))


def _rounded(fitter: Fitter, chosen: Fit) -> list[Rounding]:
    """Steps of targets, at most one a joint, that take half of what a set of causes leaves there.

    A rounding is exact: where its steps fit, they fit all of a joint's samples, and leave little.
    Of hundreds of steps one takes much of any error between few targets.
    """
    evidence = fitter.evidence
    best = dict[int, tuple[float, Rounding]]()
    for one in roundings(fitter, chosen.u, chosen.residual):
        limb = evidence.limb.with_steps(one.joint, one.sizes[0])
        fit = fitter.of(limb).fit(chosen.freed, chosen.u, slopes=chosen.slopes, again=False)
        part = evidence.parts[one.joint]
        left, before = (float((f.residual[part] ** 2).sum()) for f in (fit, chosen))
        exact = left <= (1.0 - SHAPE) * before or fit.gap2[one.joint] <= SHAPE_LEFT**2
        if exact and left <= min((1.0 - FURTHER) * before, best.get(one.joint, (np.inf,))[0]):
            best[one.joint] = left, one
    return [one for _, one in best.values()]


def _lost(fitter: Fitter, chosen: Fit, ordinary: Ordinary) -> Losses | None:
    """Packets whose loss takes half of what a set of causes leaves; of an ordinary gap nearly all.

    Losses and the fit find each other in turns. They are exact wherever they are found, so that an
    ordinary gap may be theirs: where the law is exact as well and nothing rattles, its likelihood
    is enough.
    """
    evidence = fitter.evidence
    before = replace(chosen, gap2=squared_gaps(evidence, chosen.residual), strain2=0.0)
    rattles = evidence.rattles or any(fitter.parameters[k].place == PLAY for k in chosen.freed)
    likely = ordinary.exact and not rattles and chosen.worst <= ordinary.floors
    if not likely and before.worst < QUIET:
        return None
    lost, fit = losses(fitter, chosen.u, chosen.residual), chosen
    for _ in range(TURNS):
        if lost is None:
            return None
        limb = arrived(evidence.limb, lost)
        fit = fitter.of(limb).fit(chosen.freed, fit.u, slopes=fit.slopes, again=False)
        lost = losses(fitter, fit.u, fit.residual, lost) or lost
    if lost is None or lost.chance < BY_CHANCE:
        return None
    is_small = before.worst <= ordinary.floors
    enough = share_of(fit, before) >= (SHAPE if is_small else FURTHER)
    return lost if likely or (enough and (fit.worst <= SHAPE_LEFT or not is_small)) else None


def _evidence(part: Spec, log: Log, asked: Asked) -> tuple[Evidence, tuple[str, ...]]:
    """What a log says of a limb, and notes on what of it cannot be used."""
    some, whole_s = excerpted(log, part, FITTED_S)
    if asked.rigid:
        some = with_own_steps(log, part, some)
    limb = Limb(spec=part, recordings=some, rigid=asked.rigid, exact=asked.origin.exact)
    limb, notes = checked(limb)
    if (lasts_s := sum(float(one.time_s[-1]) for one in some)) < SHORTER * whole_s:
        notes = (*notes, LONG.format(lasts_s, whole_s))
    said = evidence(limb)
    if said.only_rests:
        notes = (*notes, f"{', '.join(limb.joints)}: {RESTS.format(1e3 * limb.period_s)}")
    return spreading(World(said)), notes
