"""Let a solve function answer a blind set, and write its answers where the score reads them.

    found = solve_set(Path("blind/a"), by_diagnosis, jobs=2)

A solve function gets a `Task`, which is all that a solver may know of a case, and gives plain data
(`plain` says which; of another program's, `verdict` and `joints` are enough). It is a function of a
module, so that other processes find it by its name.
"""

import hashlib
import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import joblib

from backends.catalogue import catalogue
from backends.effect import Effect
from backends.spec import Spec
from diagnosis.answer import Diagnosis
from diagnosis.blind import frozen, rigs
from diagnosis.blind.files import BlindSet, now, write_json
from diagnosis.logs.log import HandMechanism, Log, LogError, read_log
from diagnosis.motion.batch import Simulate
from diagnosis.verdict.ordinary import ROBOTS, SIMULATORS
from diagnosis.verdict.probability import features
from diagnosis.verdict.result import Cause


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

    @property
    def known(self) -> dict[str, type[Effect]]:
        """The solver's catalogue."""
        return {name: kind for name, kind in catalogue().items() if name not in self.excluded}


Solve = Callable[[Task], Mapping[str, Any]]


def task(blind: BlindSet, number: int) -> Task:
    """A case of a set."""
    log, given = read_log(blind.log(number)), blind.given(number)
    mechanism = log.meta.mechanism
    return Task(
        log=log,
        nominal=rigs.nominal(mechanism.hand) if isinstance(mechanism, HandMechanism) else None,
        healthy=tuple(map(read_log, blind.healthy_logs(number))),
        excluded=given.excluded,
        robot=given.robot,
    )


def solve_set(folder: Path, solve: Solve, jobs: int = 1) -> list[dict[str, Any]]:
    """Run a solve function on every case of a set, in order, and write its results."""
    blind, name = BlindSet(path=folder), identity(solve)
    blind.note_try(name)
    parallel = joblib.Parallel(n_jobs=jobs)
    return parallel(joblib.delayed(solve_case)(blind, n, solve, name) for n in blind.numbers)


def solve_case(
    blind: BlindSet, number: int, solve: Solve, solver_sha256: str | None = None
) -> dict[str, Any]:
    """Solve one case and write its result."""
    row = solved(blind, number, solve, solver_sha256)
    write_json(blind.result(number), row)
    return row


def solved(
    blind: BlindSet, number: int, solve: Solve, solver_sha256: str | None = None
) -> dict[str, Any]:
    """The result of a case, bound to its log, the solver and the time.

    A case on which the function fails is a wrong answer with the reason. `solver_sha256`: its
    `identity`, which no other process can tell of a function of the program that runs.
    """
    began_s, found = sum(os.times()[:2]), dict[str, Any]()
    try:
        one = task(blind, number)
        found = {"refused": None, **solve(one)}
    except LogError as error:
        found = {"refused": str(error)}
    except Exception as error:  # noqa: BLE001 - it counts as a wrong answer, not as no case
        found = {"refused": f"failed: {type(error).__name__}: {error}"}
    return {
        "number": number,
        "log_sha256": blind.log_sha256(number),
        "solver_sha256": solver_sha256 or identity(solve),
        "time": now(),
        "excluded": list(blind.given(number).excluded),
        "cpu_s": sum(os.times()[:2]) - began_s,
        **found,
    }


def identity(solve: Solve) -> str:
    """SHA-256 of a solver: of this repository's files, or of the file with another's function."""
    function = solve.func if isinstance(solve, partial) else solve
    if function is by_diagnosis:
        return frozen.solver_sha256()
    return hashlib.sha256(Path(inspect.getfile(function)).read_bytes()).hexdigest()


def solver(simulate: Simulate) -> Solve:
    """This repository's solver; `simulate` starts worlds on the nominal engine, for grasps."""
    return partial(by_diagnosis, simulate=simulate)


def by_diagnosis(one: Task, simulate: Simulate | None = None) -> dict[str, Any]:
    """The result of the diagnosis, as a user gets it."""
    from diagnosis.walk import diagnose

    found = diagnose(
        one.log,
        one.healthy,
        nominal=one.nominal,
        catalogue=one.known,
        origin=ROBOTS if one.robot else SIMULATORS,
        simulate=simulate,
    )
    return plain(found)


def plain(found: Diagnosis) -> dict[str, Any]:
    """A diagnosis in the form of the score: magnitudes in SI units or shares."""
    lead = sorted((c for limb in found.limbs for c in limb.leading), key=lambda c: -c.share)
    shares = [cause.share for cause in lead[:2]]
    ties = [[name.split("@")[0] for name in tie] for limb in found.limbs for tie in limb.tied]
    gap = max(limb.gap_nominal for limb in found.limbs)
    return {
        "verdict": list(found.verdict),
        "joints": list(found.joints),
        "magnitudes": [_magnitude(cause) for cause in found.magnitudes],
        "confidence": found.probability,
        "share": found.share,
        "left": found.left,
        "ordinary": found.ordinary,
        "leading": [cause.effect for cause in lead],
        "features": features(
            share=found.share,
            gap=gap / found.ordinary,
            left=found.left / found.ordinary,
            ties=len(ties),
            causes=len(found.magnitudes),
            lead=shares[0] - shares[1] if len(shares) > 1 else 1.0,
        ),
        "indistinguishable": [[*tie, *found.verdict] for tie in ties],
        "gap_nominal": gap,
        "cpu_s": found.cpu_s,
    }


def _magnitude(cause: Cause) -> dict[str, Any]:
    """In SI units or as a share."""
    value, low, high = cause.sizes
    return {
        "effect": cause.effect,
        "joints": list(cause.joints),
        "magnitude": value,
        "interval": [low, high],
    }
