"""From what a search found to what is said of a limb: named, none or unknown, and how sure."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from backends.effect import UNITS
from diagnosis.models.loops import is_term, said
from diagnosis.models.parameters import Parameter, magnitude
from diagnosis.motion.columns import DELAY, LATE, ONCE, STOP
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.search import TIE_SHARE, Found
from diagnosis.verdict import probability as curve
from diagnosis.verdict.experiment import experiment
from diagnosis.verdict.ordinary import LOSSES, Ordinary, allowed, is_named
from diagnosis.verdict.result import NONE, UNKNOWN, Z90, Cause, LimbResult, Nominal, Ranked, cause
from diagnosis.verdict.sentences import size

LEADING, RANKED = 3, 6
"""So many causes lead, and so many sets are ranked."""
OFF, OFF_LEFT = 0.03, 0.5
"""Sizes and places are off by such a share, and by this times the share of the gap that is left,
beside their standard deviation: laws are models."""
MOVED = 0.5
"""A nominal number took part in the fit where it moved by so many of its standard deviations."""


def decide(
    fitter: Fitter,
    found: Found,
    ordinary: Ordinary,
    sensors: Sequence[Cause] = (),
    explained: float = 0.0,
) -> LimbResult:
    """What is said of a limb; `explained`: the gap that lost packets took part of [floors].

    Likelihood alone names nothing whose size may be none, and no ordinary gap what files do not
    say.
    """
    nominal, chosen = found.nominal, found.chosen
    causes = tuple(_causes(fitter, found)) if chosen.freed else ()
    likely = found.is_likely and all(one.low * one.high > 0.0 for one in causes)
    closes = bool(chosen.freed) and is_named(chosen, nominal, ordinary)
    only = all(fitter.parameters[k].is_unsaid for k in chosen.freed)
    if nominal.worst <= ordinary.floors and only:
        causes = ()
    if causes and (closes or likely):
        kind, tied = curve.NAMED, found.tied
    else:
        most = allowed(explained, replace(ordinary, law=LOSSES))
        kind, tied, causes = UNKNOWN if nominal.gap > most else NONE, (), ()
    best = chosen if causes else nominal
    law = said(fitter, chosen.u) if closes and kind != NONE else ""
    share = found.share(chosen) if chosen.freed else 0.0
    alone = [f for f in found.singles if not is_term(fitter.parameters[f.freed[0]])]
    close = [f for f in alone if not law or found.share(f) > share - TIE_SHARE]
    shares = [found.share(f) for f in found.singles[:2]]
    features = curve.features(
        share=share,
        gap=nominal.worst / ordinary.floors,
        left=chosen.worst / ordinary.floors,
        ties=len(tied),
        causes=len(chosen.freed) - len(_unsaid(fitter, found)),
        lead=shares[0] - shares[1] if len(shares) > 1 else 1.0,
    )
    return LimbResult(
        joints=fitter.evidence.joints,
        verdict=tuple(one.effect for one in causes) or (kind,),
        causes=causes,
        leading=tuple(_cause(fitter, found, f, f.freed[0]) for f in close[:LEADING]),
        sensors=tuple(sensors),
        share=share,
        left=nominal.gap if kind == NONE else chosen.gap,
        ordinary=ordinary.floors,
        ordinary_from=ordinary.source,
        probability=curve.probability(kind, features),
        ranking=tuple(_ranked(fitter, found, best)),
        tied=tuple(tuple("@".join(filter(None, _spot(fitter, k))) for k in f.freed) for f in tied),
        experiment=experiment(fitter, chosen, tied) if tied else None,
        gap_before=float(np.sqrt(np.mean((fitter.evidence.readings - fitter.shown({})) ** 2))),
        gap_nominal=nominal.gap,
        gaps=dict(zip(fitter.evidence.joints, map(float, np.sqrt(nominal.gap2)), strict=True)),
        nominal=tuple(_nominal(fitter, best, _unsaid(fitter, found) if causes else ())),
        strain=fitter.usual.off(nominal) if fitter.usual else 0.0,
        law=law,
    )


def _causes(fitter: Fitter, found: Found) -> Iterator[Cause]:
    """The chosen effects; of a family at a joint, the one that takes most by itself."""
    alone = {f.freed: f.excess for f in found.singles}
    parameters, chosen = fitter.parameters, found.chosen
    beside = _unsaid(fitter, found)
    for k in (k for k in chosen.freed if not is_term(parameters[k]) and k not in beside):
        kin = [a for a in chosen.freed if parameters[a].is_kin(parameters[k])]
        if kin and k != min(kin, key=lambda a: alone.get((a,), np.inf)):
            continue
        more = [_cause(fitter, found, chosen, a) for a in kin if a != k]
        shape = tuple(f"{one.effect} of {size(one)}" for one in more)
        yield replace(_cause(fitter, found, chosen, k), shape=shape)


def _unsaid(fitter: Fitter, found: Found) -> list[int]:
    """What of the chosen set no file says, and leaves more alone than another of the set."""
    alone, freed = {f.freed: f.excess for f in found.singles}, found.chosen.freed
    least = min((alone.get((k,), np.inf) for k in freed), default=np.inf)
    return [k for k in freed if fitter.parameters[k].is_unsaid and alone.get((k,), np.inf) > least]


def _cause(fitter: Fitter, found: Found, fit: Fit, number: int) -> Cause:
    one, u = fitter.parameters[number], fit.u[number]
    alone = [f for f in found.singles if f.freed == (number,)]
    kept = fit.worst / max(found.nominal.worst, 1e-9)
    off = OFF + OFF_LEFT * min(kept, 1.0)
    alike = (p for p in fitter.parameters if p.effect == one.effect and p.part_of is None)
    own = max((p.tolerance for p in alike if one.joint in (p.joint, None)), default=0.0)
    wide = Z90 * float(np.sqrt(fit.sd.get(number, 0.0) ** 2 + own**2 + (off * u) ** 2))
    ends = max(u - wide, one.lowest), min(u + wide, max(one.most, u))
    if one.place in (DELAY, LATE):
        ends = ends[0], ends[1] + fitter.evidence.limb.unsure_s
    low, high = sorted(_magnitude(fitter, one, x) for x in ends)
    sizes = [_magnitude(fitter, one, u), low, high]
    effect, joint = _spot(fitter, number)
    said = cause(
        effect,
        sizes,
        {effect: one.kind},
        fitter.evidence.joints if joint is None else (joint,),
        fitter.evidence.place(one.joint),
        share=found.share(alone[0] if alone else fit),
    )
    also = ", ".join(filter(None, (said.also, _away(fitter, fit, number, off))))
    return replace(said, joint=joint, also=also)


def _away(fitter: Fitter, fit: Fit, number: int, off: float) -> str:
    """Where on its link or joint an effect acts, in words; empty where its law has no place.

    `off`: the share that laws are off by, beside the standard deviation.
    """
    one, parts = fitter.parameters[number], fitter.parameters
    limb, spots = fitter.evidence.limb, [k for k, p in enumerate(parts) if p.part_of == number]
    if one.joint is None and spots:
        sizes = (f"{p.value:.3g} {p.unit} on {p.joint}" for p in _by_joint(fitter, fit, number))
        return ", ".join(sizes)
    if one.joint is None or not one.kind.spot or one.place == STOP or fit.u[number] < 0.0:
        return ""
    at = limb.nominal[one.joint, [parts[k].place for k in spots]]
    at = at + [parts[k].unit * fit.u.get(k, 0.0) for k in spots]
    sds = np.array([parts[k].unit * fit.sd.get(k, parts[k].tolerance) for k in spots])
    if one.place == ONCE:
        across = fit.u[number] * one.unit, float(at[0])
        turn, amplitude = np.degrees([np.arctan2(*across[::-1]), np.hypot(*across)])
        return f"{amplitude:.3g} deg once per turn, most at {turn:.3g} deg"
    if not one.kind.is_of("body"):
        unit = "mm" if limb.spec.hand.driven[one.joint].joint.slides else "deg"
        where, sd = (float(x) / UNITS[unit][1] for x in (at[0], np.hypot(sds[0], off * at[0])))
        return f"at rest at {where:.3g} ± {sd:.2g} {unit}"
    away_m = float(np.linalg.norm(at))
    sd = np.hypot(np.linalg.norm(at * sds) / max(away_m, 1e-9), off * away_m)
    return f"{1e3 * away_m:.3g} ± {1e3 * sd:.2g} mm from its joint"


def _by_joint(fitter: Fitter, fit: Fit, number: int) -> Iterator[Nominal]:
    """How much every joint has of what no file says, as sure as its law is."""
    one = fitter.parameters[number]
    sizes = fitter.numbers(fit.u)[0][:, one.place]
    for part in fitter.parameters:
        if part.part_of == number and part.joint is not None:
            size = float(sizes[part.joint])
            sd = np.hypot(OFF * size, one.kind.tolerance * part.unit)
            unit = one.kind.unit_of(size, fitter.evidence.place(part.joint).slides)
            value, sd = size / UNITS[unit][1], float(sd) / UNITS[unit][1]
            joint = fitter.evidence.joints[part.joint]
            yield Nominal(effect=one.effect, joint=joint, value=value, sd=sd, unit=unit)


def _magnitude(fitter: Fitter, one: Parameter, u: float) -> float:
    """The effect's magnitude [SI]."""
    return float(magnitude(one, u, fitter.evidence.limb.nominal[one.joint or 0]))


def _spot(fitter: Fitter, number: int) -> tuple[str, str | None]:
    """An effect and its joint; None: all, or none."""
    one, joints = fitter.parameters[number], fitter.evidence.joints
    return one.effect, None if one.joint is None else joints[one.joint]


def _ranked(fitter: Fitter, found: Found, best: Fit) -> Iterator[Ranked]:
    """The best set, which may be none, then single effects."""
    rest = [f for f in found.singles if f.freed != best.freed]
    for fit in (best, *rest[:RANKED]):
        causes = tuple(_spot(fitter, k) for k in fit.freed)
        yield Ranked(causes=causes, share=found.share(fit), left=fit.gap)


def _nominal(fitter: Fitter, fit: Fit, unsaid: Sequence[int]) -> Iterator[Nominal]:
    """Numbers of the mechanism's file that took part of the gap, beside what causes change.

    And `unsaid` ones, which no cause is.
    """
    common = {fitter.parameters[k].effect for k in fit.freed if fitter.parameters[k].joint is None}
    for k in unsaid:
        yield from _by_joint(fitter, fit, k)
    for k, one in enumerate(fitter.parameters):
        u = fit.u.get(k, 0.0)
        is_own = k in fit.freed or one.part_of is not None or one.effect in common
        if u and not is_own and abs(u) >= MOVED * one.tolerance:
            ends = (u, u + fit.sd.get(k, one.tolerance))
            if one.kind.coordinate == "logarithm":
                (value, end), unit = (float(np.expm1(x)) for x in ends), "%"
            else:
                value, end = (_magnitude(fitter, one, x) for x in ends)
                unit = one.kind.unit_of(value, fitter.evidence.place(one.joint).slides)
            value, sd = (float(x) / UNITS[unit][1] for x in (value, abs(end - value)))
            effect, joint = _spot(fitter, k)
            yield Nominal(effect=effect, joint=joint or "", value=value, sd=sd, unit=unit)
