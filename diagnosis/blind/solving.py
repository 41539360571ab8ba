"""Let any solve function answer a blind set, and write its answers where the score reads them.

    found = solve_set(Path("blind/a"), by_share, jobs=2)

A solve function gets a `Task`, which is all that a solver may know of a case, and gives plain data
(`diagnosis.blind.solve.solve` says which). It is a function of a module, so that other processes
find it by its name.
"""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib

from backends.effect import UNITS, Effect
from backends.spec import Spec
from diagnosis.blind import frozen, rigs
from diagnosis.blind.files import BlindSet, read_json, write_json
from diagnosis.logs.log import HandMechanism, Log, read_log

NAMED, NONE, UNKNOWN = "named", "none", "unknown"


@dataclass(frozen=True, kw_only=True)
class Task:
    """One case as a solver sees it."""

    log: Log
    nominal: Spec | None
    """The nominal world of a hand; None if the log has an MJCF."""
    healthy: tuple[Log, ...]
    """Healthy logs of the same mechanism."""
    excluded: tuple[str, ...]
    """Effects that are removed from the solver's catalogue."""
    robot: bool
    """Whether the log is from a robot, as far as the solver knows, and not from a simulator."""


Solve = Callable[[Task], Mapping[str, Any]]


def task(blind: BlindSet, number: int) -> Task:
    """A case of a set."""
    log, given = read_log(blind.log(number)), read_json(blind.log(number) / "case.json")
    mechanism, make = log.meta.mechanism, given.get("make")
    folders = [] if make is None else sorted(blind.healthy(make).iterdir())
    is_hand = isinstance(mechanism, HandMechanism)
    return Task(
        log=log,
        nominal=rigs.nominal(mechanism.hand) if isinstance(mechanism, HandMechanism) else None,
        healthy=tuple(read_log(folder) for folder in folders),
        excluded=tuple(given["excluded"]),
        robot=bool(given.get("robot", not is_hand)),
    )


def solve_set(folder: Path, solve: Solve, jobs: int = 1) -> list[dict[str, Any]]:
    """Run a solve function on every case of a set, in order, and write its results.

    A case on which it fails is a wrong answer with the reason.
    """
    blind, solver = BlindSet(path=folder), frozen.solver()
    blind.note_try(**solver)
    parallel = joblib.Parallel(n_jobs=jobs)
    return parallel(joblib.delayed(_one)(blind, n, solve, solver) for n in blind.numbers)


def _one(blind: BlindSet, number: int, solve: Solve, solver: Mapping[str, Any]) -> dict[str, Any]:
    began_s, excluded = sum(os.times()[:2]), list(blind.excluded(number))
    try:
        said = dict(solve(task(blind, number)))
    except Exception as error:  # noqa: BLE001 - it counts as a wrong answer, not as no case
        said = {"refused": f"failed: {type(error).__name__}: {error}"}
    facts: dict[str, Any] = {"refused": None, "catalogue": []}
    facts["cpu_s"] = sum(os.times()[:2]) - began_s
    row = {"number": number, "excluded": excluded, **facts, **said, **solver}
    write_json(blind.result(number), row)
    return row


def by_share(one: Task) -> dict[str, Any]:
    """The result of the solver that decides by shares of the gap."""
    from diagnosis.models.catalogue import catalogue
    from diagnosis.solver import solve
    from diagnosis.verdict.ordinary import ROBOTS, SIMULATORS

    known: dict[str, type[Effect]] = {
        name: kind for name, kind in catalogue().items() if name not in one.excluded
    }
    found = solve(
        one.log,
        one.healthy,
        nominal=one.nominal,
        catalogue=known,
        origin=ROBOTS if one.robot else SIMULATORS,
    )
    return {"catalogue": sorted(known), **plain(found)}


def plain(found: Any) -> dict[str, Any]:
    """A `verdict.result.Result` in the form of the score: magnitudes in SI units or shares."""
    from diagnosis.verdict.probability import features

    lead = [cause for limb in found.limbs for cause in limb.leading]
    lead.sort(key=lambda cause: -cause.share)
    shares = [cause.share for cause in lead[:2]]
    ties = [list(tie) for limb in found.limbs for tie in limb.tied]
    kind = found.verdict[0] if found.verdict[0] in (NONE, UNKNOWN) else NAMED
    return {
        "verdict": list(found.verdict),
        "joints": list(found.joints),
        "magnitudes": [_magnitude(cause) for cause in found.causes],
        "confidence": found.probability,
        "kind": kind,
        "share": found.share,
        "left": found.left,
        "ordinary": found.ordinary,
        "leading": [cause.effect for cause in lead],
        "features": features(
            share=found.share,
            gap=found.gap_nominal / found.ordinary,
            left=found.left / found.ordinary,
            ties=len(ties),
            causes=len(found.causes),
            lead=shares[0] - shares[1] if len(shares) > 1 else 1.0,
        ),
        "indistinguishable": [
            [name.split("@")[0] for name in tie] + list(found.verdict) for tie in ties
        ],
        "shrinkage": _shrinkage(found.gap_before, found.gap_after),
        "shrinkage_nominal": _shrinkage(found.gap_before, found.gap_nominal),
        "cpu_s": found.cpu_s,
    }


def _magnitude(cause: Any) -> dict[str, Any]:
    size = UNITS[cause.unit][1]
    return {
        "effect": cause.effect,
        "joints": list(cause.joints),
        "magnitude": cause.value * size,
        "interval": [cause.low * size, cause.high * size],
    }


def _shrinkage(before: float, after: float) -> float | None:
    """Share of the squared gap that is gone; None where there was none."""
    found = 1 - (after / before) ** 2 if before > 0 else math.nan
    return found if math.isfinite(found) else None
