"""Solve one blind case from its log alone."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from backends.effect import UNITS, Effect
from backends.spec import Spec
from diagnosis.attribution.sound import Sound
from diagnosis.blind import rigs
from diagnosis.calibration.worlds import Simulate
from diagnosis.diagnose import Diagnosis, diagnose, healthy, shrinkage
from diagnosis.logs.log import HandMechanism, Log, LogError, read_log
from diagnosis.replay.nominal import mjcf_world, own_catalogue


def solve(
    folder: Path,
    excluded: tuple[str, ...],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
    sound: Sequence[Sound] = (),
) -> dict:
    """The solver's result for a log without the excluded effects; magnitudes in SI units.

    `simulate` starts worlds on the nominal engine, for grasps; `sound` are the residuals of healthy
    logs of the same plant. A refused log gives its reason as `refused` and counts as no answer.
    """
    known = {name: kind for name, kind in catalogue.items() if name not in excluded}
    log, nominal = _read(folder)
    fitting = known if log.mjcf_xml is None else own_catalogue(known, nominal)
    try:
        found = diagnose(log, nominal, fitting, map, simulate, sound)
    except LogError as error:
        return {"refused": str(error), "catalogue": sorted(known)}
    return {"refused": None, "catalogue": sorted(known), **_said(found)}


def left_sound(folders: Iterable[Path], catalogue: Mapping[str, type[Effect]]) -> tuple[Sound, ...]:
    """The residuals of every limb in healthy logs, see `diagnosis.diagnose.healthy`."""
    return healthy([_read(folder) for folder in folders], catalogue)


def _read(folder: Path) -> tuple[Log, Spec]:
    log = read_log(folder)
    mechanism = log.meta.mechanism
    if isinstance(mechanism, HandMechanism):
        return log, rigs.nominal(mechanism.hand)
    return log, mjcf_world(log)


def _said(found: Diagnosis) -> dict:
    return {
        "verdict": list(found.verdict),
        "joints": list(found.joints),
        "magnitudes": [
            {
                "effect": m.effect,
                "joints": list(m.joints),
                "magnitude": m.value * UNITS[m.unit][1],
                "interval": [end * UNITS[m.unit][1] for end in m.interval],
            }
            for m in found.magnitudes
        ],
        "confidence": found.confidence,
        "ranking": list(found.ranking),
        "indistinguishable": [row["effects"] for row in found.indistinguishable],
        "missing": list(found.missing),
        "gap_before": found.gap_before,
        "gap_nominal": found.gap_nominal,
        "gap_after": found.gap_after,
        "shrinkage": found.shrinkage.value,
        "shrinkage_nominal": found.shrinkage_nominal.value,
        "greedy": _greedy(found),
        "cpu_s": found.cpu_s,
    }


def _greedy(found: Diagnosis) -> dict:
    """The single largest improvement on training samples, whatever it is: a baseline."""
    leads, limbs = [], [limb.told or limb for limb in found.limbs]
    for limb in limbs:
        best = min(limb.attribution.singles, key=lambda one: one.fit.cost)
        leads.append((limb.attribution.nominal.fit.cost - best.fit.cost, limb, best))
    _, guilty, best = max(leads, key=lambda lead: lead[0])
    before = np.concatenate([limb.attribution.before.plain for limb in limbs])
    after = np.concatenate(
        [best.plain if limb is guilty else limb.attribution.nominal.plain for limb in limbs]
    )
    joint = best.joints[0]
    return {
        "effect": best.names[0],
        "joints": list(guilty.attribution.fitter.evidence.joints) if joint is None else [joint],
        "shrinkage": shrinkage(before, after).value,
    }
