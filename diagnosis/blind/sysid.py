"""A rival method: MuJoCo's system identification of all parameters; it names the largest change.

`mujoco.sysid` fits parameters and names no cause. Its optimiser and its normalisation of sensors
are used unchanged. Worlds are replayed by the solver's compiled replay, which equals MuJoCo up to
rounding (see `replay.agreement`), because MuJoCo's own actuators have no play, lock or rate limit.
"""

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import ModuleType

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.candidates import Candidate, candidates, scale_of
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.gather import gather
from diagnosis.attribution.rules import rules
from diagnosis.blind import rigs
from diagnosis.blind.files import BlindError
from diagnosis.logs.log import HandMechanism, read_log
from diagnosis.shrinkage import shrinkage

NAME = "mujoco-sysid"
ITERATIONS = 50
"""Largest number of iterations of the optimiser; its own default is 200, and few cases need as
many."""


@dataclass(frozen=True, kw_only=True)
class Freed:
    """A limb with all its identified parameters."""

    effects: tuple[Effect, ...]
    changes: Array
    """Changes of the parameters over their natural sizes, shape (K,)."""


def identify(
    folder: Path, excluded: tuple[str, ...], catalogue: Mapping[str, type[Effect]]
) -> dict:
    """The rival's result for a log: one effect, its shrinkage on held-out samples, CPU seconds.

    Raises BlindError if `mujoco.sysid` is not installed, LogError for a log without evidence.
    """
    began_s, tool = sum(os.times()[:2]), _tool()
    known = {name: kind for name, kind in catalogue.items() if name not in excluded}
    log = read_log(folder)
    mechanism = log.meta.mechanism
    assert isinstance(mechanism, HandMechanism)
    before, after, largest, named = [], [], 0.0, ""
    for part in gather(log, rigs.nominal(mechanism.hand), rules().floor):
        free = [c for c in candidates(known, part) if c.joint or not c.kind.per_joint]
        found = _freed(tool, part, free)
        before.append(part.residual((), True, False) ** 2)
        after.append(part.residual(found.effects, True, False) ** 2)
        most = int(np.argmax(np.abs(found.changes)))
        if abs(found.changes[most]) > largest:
            largest, named = abs(float(found.changes[most])), free[most].name
    return {
        "effect": named,
        "shrinkage": shrinkage(np.concatenate(before), np.concatenate(after)).value,
        "cpu_s": sum(os.times()[:2]) - began_s,
    }


def _tool() -> ModuleType:
    tool = import_module("mujoco.sysid")
    if not hasattr(tool, "optimize"):  # it hides what it misses
        needed = "pip install -c constraints.txt 'mujoco[sysid]'"
        raise BlindError(f"mujoco.sysid lacks what it needs; run: {needed}")
    logging.getLogger("absl").setLevel(logging.ERROR)  # that friction starts at its bound: zero
    return tool


def _freed(tool: ModuleType, part: Evidence, free: Sequence[Candidate]) -> Freed:
    """All parameters, fitted together from their nominal values to the samples for fitting."""
    sizes = np.array([scale_of(c.kind, part, c.joint) for c in free])
    alike = replace(part, sigma=_norms(part))

    def effects(changes: Array) -> tuple[Effect, ...]:
        pairs = zip(free, changes * sizes, strict=True)
        return tuple(c.kind(magnitude=float(size), joint=c.joint) for c, size in pairs if size)

    def residual(x: Array, _: object) -> tuple[list[Array], None, None]:
        """The residual at one point (K,) or at several (K, P)."""
        points = x.reshape(len(free), -1).T
        columns = [alike.residual(effects(point), False, compress=False) for point in points]
        return [np.stack(columns, axis=1)], None, None

    parameters = tool.ParameterDict()
    for number, (one, size) in enumerate(zip(free, sizes, strict=True)):
        low, high = one.kind.bounds
        parameters.add(tool.Parameter(f"{one.name}-{number}", 0.0, low / size, high / size))
    quiet = {"verbose": False, "output": StringIO()}
    found, _ = tool.optimize(parameters, residual, max_iters=ITERATIONS, **quiet)
    changes = found.as_vector()
    return Freed(effects=effects(changes), changes=changes)


def _norms(part: Evidence) -> Array:
    """The scale of each sensor in `mujoco.sysid`, over the samples for fitting, (C, 1, J)."""
    used = [r.measured[:, ~r.judged] for r in part.recordings]
    squares = np.nansum(np.concatenate(used, axis=1) ** 2, axis=1)
    return np.maximum(np.sqrt(squares / 2), 1e-12)[:, None]
