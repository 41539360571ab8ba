"""What a solver could know at best: the true effect refitted against nominal errors alone.

A case counts as detectable when the true effects, put in by the answers, lower the cost of the
nominal refit by DETECTABLE_NATS; of a pair each must do so beside the other. This uses the solver's
own fitter, with the answers opened.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.attribute import LAST
from diagnosis.attribution.candidates import RANDOM, nuisances
from diagnosis.attribution.evidence import Evidence, gather
from diagnosis.attribution.fit import Fit, Fitter
from diagnosis.attribution.verdict import rules
from diagnosis.blind import rigs
from diagnosis.blind.draw import HELD_EFFECTS, Case, Fault
from diagnosis.diagnose import shrinkage
from diagnosis.logs.log import read_log

DETECTABLE_NATS = 6.0
"""Chosen before any case was drawn: what the solver's first rules asked of an accusation."""
STRONG_NATS = 100.0
"""From here on an effect outside of the catalogue is a strong unknown."""


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """What the answers explain of one case."""

    nats: tuple[float | None, ...]
    """By how much each true effect lowers the cost beside the others; None: not replayable."""
    shrinkage: float | None
    """Share of the squared held-out gap that is gone with all of them; None: not replayable."""
    cost_nats: float | None
    """Cost of the fit with all of them, to all samples, over all limbs; None: not replayable."""

    @property
    def detectable(self) -> bool:
        """Whether every effect shows; random ones, which no replay shows, count as showing."""
        return all(n is None or n >= DETECTABLE_NATS for n in self.nats)

    @property
    def strong(self) -> bool:
        """Whether every effect shows strongly."""
        return all(n is None or n >= STRONG_NATS for n in self.nats)


def consult(
    case: Case,
    folder: Path,
    catalogue: Mapping[str, type[Effect]],
    apart_nats: Callable[[Fault], float],
) -> Oracle:
    """The oracle's word on a case; `apart_nats` on effects of touch, stick and contact."""
    touching = {f: apart_nats(f) for f in case.faults if f.effect in HELD_EFFECTS}
    shown = [f for f in case.faults if f.effect not in (*RANDOM, *HELD_EFFECTS)]
    if not shown:
        told = tuple(touching.get(fault) for fault in case.faults)
        return Oracle(nats=told, shrinkage=None, cost_nats=None)
    log, rule = read_log(folder), rules()
    floor = {
        "position": rule.floor_position_rad,
        "motor": rule.floor_position_rad,
        "torque": rule.floor_torque_share,
    }
    nats = touching | dict.fromkeys(shown, 0.0)
    before, after, cost_nats = [], [], 0.0
    for part in gather(log, rigs.nominal(case.rig), floor):
        fitter = Fitter(part, nuisances(part.nominal, log.meta.nominal_uncertainty))
        bare, nominal = _zeros(fitter), fitter.nominal()
        whole = _fitted(fitter, _here(shown, part, catalogue), [bare, nominal.deviations])
        for fault in shown:
            left = _here([f for f in shown if f is not fault], part, catalogue)
            less = _fitted(fitter, left, [whole.deviations, nominal.deviations])
            nats[fault] += less.cost - whole.cost
        every = Fitter(part, fitter.nuisances, None)
        cost_nats += every.refit(every.at(whole.effects, whole.deviations), LAST).cost
        before.append(fitter.left(fitter.at((), bare)))
        after.append(fitter.left(whole))
    gone = shrinkage(np.concatenate(before), np.concatenate(after)).value
    found = tuple(nats.get(fault) for fault in case.faults)
    return Oracle(nats=found, shrinkage=gone, cost_nats=cost_nats)


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
