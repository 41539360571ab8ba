"""What a lost packet does: the response of a limb to a target that is off for one sample.

Near the replay, a limb answers in proportion. So a target that was kept instead of a new one shows
as the difference of both times a unit response, and any set of losses as their sum.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.models.world import World

WINDOW_S = 0.16
"""A response is followed for so long [s]: what comes later is slow, and no sign of a packet."""
NUDGE_RAD = 4e-3
"""Targets are moved by this to find a response [rad; of a slide a share of its travel]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Of all episodes end to end: T samples in N blocks, K joints."""

    command: Array
    """Targets, shape (T, K)."""
    block: Array
    """The block of every sample, shape (T,)."""
    template: Array
    """The number of every sample's response, shape (T,)."""
    unit: Array
    """Responses (R, K, W, M): to a target of joint K, W blocks of M channels, floors per rad."""
    begins: Array
    """First samples of the episodes and the end, shape (E + 1,)."""


def responses(world: World, u: Mapping[int, float]) -> Responses:
    """The responses of a limb with parameters at u."""
    evidence, limb = world.evidence, world.evidence.limb
    size = max(int(np.diff(edges).max()) for edges in limb.edges)
    per_block = round(float(np.median(np.concatenate([np.diff(e) for e in limb.edges]))))
    apart = max(per_block * round(WINDOW_S / limb.period_s / per_block), 2 * size)
    window, joints = apart // per_block, len(limb.joints)
    lengths = [len(r.time_s) for r in limb.recordings]
    begins, firsts = np.cumsum([0, *lengths]), np.cumsum([0, *(len(e) - 1 for e in limb.edges)])
    block = np.concatenate(
        [
            first + np.searchsorted(edges, np.arange(count), side="right") - 1
            for first, edges, count in zip(firsts, limb.edges, lengths, strict=False)
        ]
    )
    row = np.concatenate([np.arange(count) for count in lengths])
    template = np.zeros(len(row), dtype=np.int64)
    unit: list[list[Array]] = []
    numbers, tilt = world.numbers(u)
    base = limb.simulate(numbers, tilt)
    for offset in range(per_block):
        nudged = np.flatnonzero(row % apart == offset)
        nudged = nudged[block[nudged] + window <= len(limb.measured)]
        shown = []
        for j in range(joints):
            nudge = NUDGE_RAD * evidence.size[j]
            off = nudge * np.isin(np.arange(len(row)), nudged)[:, None] * (np.arange(joints) == j)
            every = zip(limb.recordings, np.split(off, begins[1:-1]), strict=True)
            moved = limb.with_signals(command=[r.command + more for r, more in every])
            shown.append((moved.simulate(numbers, tilt) - base) / nudge / evidence.floor)
        mine = row % per_block == offset
        middle = (nudged[1:] + nudged[:-1]) / 2
        template[mine] = len(unit) + np.searchsorted(middle, np.flatnonzero(mine))
        for k in nudged:
            part = slice(block[k], block[k] + window)
            unit.append([one[part].reshape(window, -1) for one in shown])
    command = np.concatenate([r.command for r in limb.recordings])
    return Responses(
        command=command, block=block, template=template, unit=np.array(unit), begins=begins
    )
