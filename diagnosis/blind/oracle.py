"""The oracle: what a solver could know at best, from a fit of the true effects.

A fault *shows* by what is left without it, while all other true effects are fitted: more than is
ordinary, or, where the drive law is exact, a log that is less likely by `DETECTABLE_NATS`. The
oracle uses the solver's own fitter, and its table of what is ordinary.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from backends.catalogue import catalogue
from backends.state import Array
from diagnosis.blind import rigs
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.sides import PLANTS
from diagnosis.evidence.evidence import evidence
from diagnosis.evidence.log_faults import StillError, checked
from diagnosis.logs.log import Log, LogError, read_log
from diagnosis.models.parameters import Parameter, parameters
from diagnosis.motion.columns import STIFFNESS
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fit, Fitter
from diagnosis.verdict.exact import ranked
from diagnosis.verdict.ordinary import ROBOTS, SIMULATORS, Ordinary

DETECTABLE_NATS = 6.0
"""Limit of detectability by likelihood, chosen before any case was drawn."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """How clearly one true effect shows."""

    floors: float | None = None
    """The largest gap of a joint without it; None of what only touch, stick and contact show."""
    nats: float | None = None
    """By how much less likely the log is without it; None where no likelihood is exact."""
    is_replayed: bool = True
    """Whether a replay shows it: not so noise, steps and lost packets, which have signatures."""


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """How much the true effects explain of one case."""

    ordinary: float | None = None
    """The largest gap that is ordinary on its real side [floors]; None of a drawn robot."""
    shown: tuple[Shown, ...] = ()
    """Its true effects; none of a drawn robot, whose faults `sizing` made large enough."""
    gap: float | None = None
    """What tolerances alone leave [floors]."""
    left: float | None = None
    """What the true effects leave [floors]."""
    share: float | None = None
    """The share of the excess that they take."""

    @property
    def detectable(self) -> bool:
        """Whether every effect shows; those with signatures of their own count as such."""
        return all(not s.is_replayed or self._is_beyond(s) or _is_likely(s) for s in self.shown)

    @property
    def beyond(self) -> bool:
        """Whether every effect leaves more than is ordinary."""
        return all(_is_likely(s) if s.floors is None else self._is_beyond(s) for s in self.shown)

    def _is_beyond(self, one: Shown) -> bool:
        return one.floors is not None and one.floors > (self.ordinary or 0.0)


def _is_likely(one: Shown) -> bool:
    return one.nats is not None and one.nats >= DETECTABLE_NATS


def consult(case: Case, folder: Path, apart_nats: Callable[[Fault], float]) -> Oracle:
    """Ask the oracle about a case; `apart_nats` judges effects of touch, stick and contact.

    For a drawn robot the result of `sizing` is used. Of a log that says nothing it says nothing.
    """
    if case.left_floors is not None:
        return Oracle()
    try:
        found = _free(case, read_log(folder))
    except LogError:
        return Oracle()
    shown = tuple(
        Shown(nats=apart_nats(fault)) if catalogue()[fault.effect].shows_in_hand() else one
        for fault, one in zip(case.faults, found.shown, strict=True)
    )
    return Oracle(**{**vars(found), "shown": shown})


def detectable(case: Case, log: Log) -> bool:
    """`Oracle.detectable` of a log in free air."""
    return _free(case, log).detectable


@dataclass(frozen=True, kw_only=True, eq=False)
class _Explained:
    """A limb with its tolerances alone, with all true effects, and without each of them."""

    fitter: Fitter
    nominal: Fit
    whole: Fit
    without: dict[Fault, Fit] = field(default_factory=dict)

    def nats(self, fault: Fault) -> float:
        """How much less likely the limb's log is without a fault."""
        less = self.without[fault]
        costs = {id(f): cost for cost, f in ranked(self.fitter.evidence, [less, self.whole])}
        return costs[id(less)] - costs[id(self.whole)] if less is not self.whole else 0.0


def _free(case: Case, log: Log) -> Oracle:
    """What the joints in free air show of a case."""
    origin = ROBOTS if case.real in PLANTS else SIMULATORS
    found = [_explained(case, one) for one in fitters(case, log, origin)]
    known = {kind for one in found for kind in {p.effect for p in one.fitter.parameters}}
    shown = tuple(
        Shown(
            floors=max(one.without[fault].worst for one in found),
            nats=sum(one.nats(fault) for one in found) if origin.exact else None,
            is_replayed=fault.effect in known,
        )
        for fault in case.faults
    )
    before = sum(one.nominal.excess for one in found)
    after = sum(one.whole.excess for one in found)
    return Oracle(
        ordinary=origin.floors,
        shown=shown,
        gap=max(one.nominal.worst for one in found),
        left=max(one.whole.worst for one in found),
        share=1.0 - after / before if before > 0.0 else None,
    )


def fitters(case: Case, log: Log, origin: Ordinary) -> Iterator[Fitter]:
    """The solver's fitter of every limb of a log."""
    for part in limbs(rigs.nominal(case.rig)):
        rigid = rigs.robot(case.rig) is not None
        try:
            moved = recordings(log, part)
            limb, _ = checked(Limb(spec=part, recordings=moved, rigid=rigid, exact=origin.exact))
        except StillError:
            continue
        said = evidence(limb)
        known = parameters(catalogue(), said, log.meta.nominal_uncertainty, origin.everyday)
        yield Fitter(said, known)


def _explained(case: Case, fitter: Fitter) -> _Explained:
    nominal = fitter.settled()
    starts = {fault: _starts(fault, fitter) for fault in case.faults}
    whole = _fitted(fitter, list(starts.values()), [nominal.u, {}])
    near = [{k: u for k, u in whole.u.items() if k not in whole.freed}, nominal.u]
    without = {}
    for fault in case.faults:
        rest = [start for other, start in starts.items() if other is not fault]
        without[fault] = _fitted(fitter, rest, near) if starts[fault] else whole
    return _Explained(fitter=fitter, nominal=nominal, whole=whole, without=without)


def _fitted(
    fitter: Fitter, starts: Sequence[Mapping[int, float]], near: Sequence[Mapping[int, float]]
) -> Fit:
    """Effects fitted from their true sizes, with tolerances from several starts: the best."""
    start = {number: u for one in starts for number, u in one.items()}
    fits = [fitter.fit(tuple(start), {**others, **start}) for others in near]
    return min(fits, key=lambda fit: fit.excess)


def _starts(fault: Fault, fitter: Fitter) -> dict[int, float]:
    """The parameters of a limb that a fault is, by number, at its size."""
    part, kind = fitter.evidence.limb.spec, catalogue()[fault.effect]
    if fault.joint not in (None, *fitter.evidence.joints):
        return {}
    joints = kind(magnitude=fault.magnitude, joint=fault.joint).joints(part)
    found = {}
    for number, one in enumerate(fitter.parameters):
        joint = None if one.joint is None else fitter.evidence.joints[one.joint]
        if one.effect == fault.effect and (joint in joints if kind.per_joint else joint is None):
            nominal = fitter.evidence.limb.nominal[one.joint or 0]
            low = -one.most if one.kind.either_sign else 0.0
            found[number] = float(np.clip(_size(one, fault.magnitude, nominal), low, one.most))
    return found


def _size(one: Parameter, magnitude: float, nominal: Array) -> float:
    """The coordinate u of an effect with a magnitude, see `models.parameters.magnitude`."""
    if one.is_tilt:
        return 0.0 if one.place else magnitude
    if one.kind.coordinate == "compliance":
        return magnitude / (one.unit * nominal[STIFFNESS])
    if one.kind.coordinate == "logarithm":
        share = magnitude if one.kind.dimension == "share" else magnitude / nominal[one.place]
        return float(np.log1p(share))
    return (magnitude - one.onset) / one.unit
