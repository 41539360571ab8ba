"""The oracle: what a solver could know at best, from refitting the true effects.

A case is detectable if the true effects, taken from the answers, lower the cost of the nominal
refit by DETECTABLE_NATS. In a pair, each must do so in addition to the other. The oracle uses the
solver's own fitter.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.attribute import LAST
from diagnosis.attribution.candidates import RANDOM, nuisances
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.gather import gather
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.rules import rules
from diagnosis.blind import rigs
from diagnosis.blind.draw import HELD_EFFECTS, Case, Fault
from diagnosis.diagnose import shrinkage
from diagnosis.logs.log import Log, read_log

DETECTABLE_NATS = 6.0
"""Limit of detectability, chosen before any case was drawn."""
STRONG_NATS = 100.0
"""From here on an effect outside the catalogue counts as strong."""


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """How much the true effects explain of one case."""

    nats: tuple[float | None, ...]
    """Cost reduction of each true effect in addition to the others; None: not replayable."""
    shrinkage: float | None
    """Share of the squared held-out gap that is gone with all of them; None: not replayable."""
    cost_nats: float | None
    """Cost of the fit with all of them, to all samples, over all limbs; None: not replayable."""

    @property
    def detectable(self) -> bool:
        """Whether every effect is detectable; random ones, which no replay shows, count as such."""
        return all(n is None or n >= DETECTABLE_NATS for n in self.nats)

    @property
    def strong(self) -> bool:
        """Whether every effect is strong."""
        return all(n is None or n >= STRONG_NATS for n in self.nats)


def consult(
    case: Case,
    folder: Path,
    catalogue: Mapping[str, type[Effect]],
    apart_nats: Callable[[Fault], float],
) -> Oracle:
    """Ask the oracle about a case; `apart_nats` judges effects of touch, stick and contact.

    For a drawn robot the result of `sizing` is used.
    """
    if case.left_floors is not None:
        return Oracle(nats=(None,) * len(case.faults), shrinkage=None, cost_nats=None)
    touching = {f: apart_nats(f) for f in case.faults if f.effect in HELD_EFFECTS}
    if not _shown(case):
        told = tuple(touching.get(fault) for fault in case.faults)
        return Oracle(nats=told, shrinkage=None, cost_nats=None)
    limbs = list(_explained(case, read_log(folder), catalogue))
    before, after, cost_nats = [], [], 0.0
    for fitter, whole, _ in limbs:
        every = Fitter(fitter.evidence, fitter.nuisances, None)
        cost_nats += every.refit(every.at(whole.effects, whole.deviations), LAST).cost
        before.append(fitter.left(fitter.at((), _zeros(fitter))))
        after.append(fitter.left(whole))
    gone = shrinkage(np.concatenate(before), np.concatenate(after)).value
    nats = touching | _nats(case, limbs)
    told = tuple(nats.get(fault) for fault in case.faults)
    return Oracle(nats=told, shrinkage=gone, cost_nats=cost_nats)


def detectable(case: Case, log: Log, catalogue: Mapping[str, type[Effect]]) -> bool:
    """`Oracle.detectable` of a log, without the oracle's other results."""
    nats = _nats(case, _explained(case, log, catalogue))
    return Oracle(nats=tuple(nats.values()), shrinkage=None, cost_nats=None).detectable


Explained = tuple[Fitter, Fit, dict[Fault, float]]
"""A limb, its fit with all true effects, and by how much each lowers the cost beside the others."""


def _explained(case: Case, log: Log, catalogue: Mapping[str, type[Effect]]) -> Iterator[Explained]:
    """Every limb of a case."""
    shown = _shown(case)
    for part in gather(log, rigs.nominal(case.rig), rules().floor):
        fitter = Fitter(part, nuisances(part.nominal, log.meta.nominal_uncertainty))
        nominal = fitter.nominal()
        starts = [_zeros(fitter), nominal.deviations]
        whole = _fitted(fitter, _here(shown, part, catalogue), starts)
        lost = {}
        for fault in shown:
            left = _here([f for f in shown if f is not fault], part, catalogue)
            less = _fitted(fitter, left, [whole.deviations, nominal.deviations])
            lost[fault] = less.cost - whole.cost
        yield fitter, whole, lost


def _nats(case: Case, limbs: Iterable[Explained]) -> dict[Fault, float]:
    """By how much each effect that a replay can show lowers the cost of all limbs."""
    lost = [one for _, _, one in limbs]
    return {fault: sum(one[fault] for one in lost) for fault in _shown(case)}


def _shown(case: Case) -> list[Fault]:
    """The effects that a replay can show."""
    return [f for f in case.faults if f.effect not in (*RANDOM, *HELD_EFFECTS)]


def _fitted(fitter: Fitter, effects: tuple[Effect, ...], starts: Sequence[Array]) -> Fit:
    """Effects refitted from their magnitudes, with nominal parameters free from several starts."""
    return min((fitter.refit(fitter.at(effects, d)) for d in starts), key=lambda fit: fit.cost)


def _here(
    faults: Sequence[Fault], evidence: Evidence, catalogue: Mapping[str, type[Effect]]
) -> tuple[Effect, ...]:
    """The effects that act on a limb."""
    near = [f for f in faults if f.joint is None or f.joint in evidence.joints]
    effects = [catalogue[f.effect](magnitude=f.magnitude, joint=f.joint) for f in near]
    return tuple(e for e in effects if e.on_spec(evidence.nominal) != evidence.nominal)


def _zeros(fitter: Fitter) -> Array:
    return np.zeros(len(fitter.nuisances))
