"""How far a corrected model is from its log in plain MuJoCo, in the time step that it needs.

Measured where the verdict is: on the readings that count, or where pushed joints rest.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.logs.log import Log
from diagnosis.replay.parts import limbs
from diagnosis.replay.plain import model_text, plain, shown, timestep_s
from diagnosis.verdict.lost_motion import WHEN, rests

SHORTER = 0.9
"""A time step is too long while half of it leaves no more than this share of the gap."""
MOST_STEPS = 2e5
"""A log is not tried in more steps: where drives need Python, one takes 20 microseconds."""


@dataclass(frozen=True, kw_only=True)
class PlainGap:
    """Root mean square distances of positions from a log's in plain MuJoCo [rad; of slides m]."""

    before_rad: float
    """Of the user's own file."""
    after_rad: float
    """Of the corrected one."""
    file_step_s: float
    """The time step of the user's file."""
    step_s: float
    """The one that the corrected file needs, the same or shorter."""
    by_step_rad: float
    """What that step alone would leave, with the file's numbers."""
    by_joint: dict[str, tuple[float, float]]
    """Before and after, by joint."""
    at_rest: bool = False
    """Whether all that is compared is where pushed joints rest."""


def plain_gap(
    log: Log,
    nominal: Spec,
    corrected: Spec,
    every: Sequence[Evidence],
    rested: Collection[str] = (),
) -> PlainGap:
    """The gap before and after; the corrected world's in the time step that it needs.

    Of joints that are `rested`, only rests under pushes are compared.
    """

    def off(world: Spec, step_s: float | None = None) -> dict[str, Array]:
        return _off(log, model_text(log, world, nominal, step_s), world, every, rested)

    before, own_s = off(nominal), timestep_s(log)
    after, step_s = off(corrected), own_s
    lasts_s = sum(float(r.time_s[-1]) for one in every for r in one.limb.recordings)
    while corrected != nominal and 2.0 * lasts_s / step_s <= MOST_STEPS:
        finer = off(corrected, step_s / 2)
        if not _rms(finer) <= SHORTER * _rms(after):
            break
        after, step_s = finer, step_s / 2
    alone = before if step_s == own_s else off(nominal, step_s)
    return PlainGap(
        before_rad=_rms(before),
        after_rad=_rms(after),
        file_step_s=own_s,
        step_s=step_s,
        by_step_rad=_rms(alone),
        by_joint={
            joint: (_rms({joint: off}), _rms({joint: after[joint]}))
            for joint, off in before.items()
        },
        at_rest=set(before) <= set(rested),
    )


def _rms(off: dict[str, Array]) -> float:
    values = np.concatenate(list(off.values()))
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _off(
    log: Log, text: str, world: Spec, every: Sequence[Evidence], rested: Collection[str]
) -> dict[str, Array]:
    """How far positions are from the log's in a world as it is written, by joint."""
    found, parts = dict[str, Array](), {part.hand.joint_names: part for part in limbs(world)}
    for evidence in every:
        limb = evidence.limb
        moved = plain(log, text, limb.joints, world=world)
        each = ((r, shown(moved, r, parts[limb.joints], limb)) for r in limb.recordings)
        read = (replace(r, measured=np.repeat(q[:, None], 3, axis=1)) for r, q in each)
        there = replace(evidence, limb=replace(limb, recordings=tuple(read)))
        blocks = there.limb.measured[:, 0]
        for j, joint in enumerate(limb.joints):
            off = blocks[:, j] - evidence.measured[:, 0, j]
            if joint in rested:
                off = (rests(there, j)[WHEN] - rests(evidence, j)[WHEN]).to_numpy().ravel()
            found[joint] = off[np.isfinite(off)]
    return found
