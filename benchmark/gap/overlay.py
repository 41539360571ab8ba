"""A log's free-air motion beside its worlds: what was measured, the nominal and the corrected one.

The corrected world has the causes that a diagnosis names and the nominal numbers that it refitted,
as far as they are numbers of joints.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from backends.spec import Spec
from backends.state import Array
from benchmark.errors import UsageError
from benchmark.gap.diagnose import FILE, OUT, nominal_world
from diagnosis.answer import Diagnosis
from diagnosis.logs.log import Log, LogError, MjcfMechanism, read_log
from diagnosis.motion.columns import COLUMNS
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.parts import limbs

NOMINAL, CORRECTED = "nominal", "corrected"


@dataclass(frozen=True, kw_only=True)
class Overlay:
    """N moments of a log's free-air episodes, one after the other; angles of its J joints."""

    spec: Spec
    """The nominal world."""
    episode: Array
    """Number of the episode among those in free air, shape (N,)."""
    protocols: tuple[str, ...]
    """Of these episodes."""
    time_s: Array
    """Within the episode [s], shape (N,)."""
    measured: Array
    """Positions [rad; of slides m], shape (N, J), spec order; NaN where none were logged."""
    worlds: dict[str, Array]
    """Positions by world: nominal, and corrected where there is a diagnosis."""


def overlay(log: Log, nominal: Spec, found: Diagnosis | None) -> Overlay:
    """The replays of a log in its worlds; raises LogError where there is no free air."""
    rigid = isinstance(log.meta.mechanism, MjcfMechanism)
    parts = [
        Limb(spec=part, recordings=recordings(log, part), rigid=rigid) for part in limbs(nominal)
    ]
    names = [name for limb in parts for name in limb.joints]
    order = [names.index(name) for name in nominal.hand.joint_names]
    worlds = {NOMINAL: [limb.simulate(limb.nominal) for limb in parts]}
    if found is not None:
        worlds[CORRECTED] = [_corrected(limb, found) for limb in parts]
    times_s = parts[0].time_s
    return Overlay(
        spec=nominal,
        episode=np.repeat(np.arange(len(times_s)), [len(t) for t in times_s]),
        protocols=tuple(one.protocol for one in parts[0].recordings),
        time_s=np.concatenate(times_s),
        measured=np.hstack([limb.measured[:, 0] for limb in parts])[:, order],
        worlds={name: np.hstack([s[:, 0] for s in w])[:, order] for name, w in worlds.items()},
    )


def _corrected(limb: Limb, found: Diagnosis) -> Array:
    """What a limb's sensors show (N, 3, K) in the corrected world."""
    rows = limb.nominal.copy()
    for row, joint in zip(rows, limb.joints, strict=True):
        for name, value in found.corrected.get(joint, {}).items():
            row[COLUMNS.index(name)] = value
    if found.gravity_m_s2 is not None:
        limb = replace(limb, spec=replace(limb.spec, gravity_m_s2=found.gravity_m_s2))
    return limb.simulate(rows)


def read_overlay(folder: Path, diagnosis: Path | None) -> tuple[Overlay, str]:
    """The overlay of a log in a folder, and what its diagnosis says; raises UsageError.

    `diagnosis` is a folder that `bench diagnose` has written; None: the one named after the log,
    without which no corrected world is shown.
    """
    file = (diagnosis or OUT / folder.resolve().name) / FILE
    if diagnosis is not None and not file.exists():
        raise UsageError(f"no {FILE} in {diagnosis}; `bench diagnose {folder}` writes one")
    try:
        log = read_log(folder)
        found, known, said = None, None, f"no diagnosis yet: bench diagnose {folder}"
        if file.exists():
            data = json.loads(file.read_text())
            found, known, said = Diagnosis.of(data), data["nominal"]["effects"], data["sentence"]
        world = nominal_world(log, known)
        return overlay(log, world.spec, found), said
    except LogError as error:
        raise UsageError(str(error)) from error
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{file} is no diagnosis of a log's model; diagnose it again") from error
