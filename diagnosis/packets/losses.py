"""Whether packets were lost on the way to a limb, which, and how many.

Near the replay, a limb answers in proportion. So a target that was kept instead of a new one shows
as the difference of both times a unit response, and any set of losses as their sum.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from backends.state import Array
from diagnosis.models.world import World
from diagnosis.motion.limb import Limb
from diagnosis.packets.decode import decode, surprise
from diagnosis.packets.rounding import RESPONSE_S
from diagnosis.verdict.result import Z90

START = 0.1
"""Share of losses that the first decoding assumes."""
SHARES = (0.01, 0.85)
"""Of lost packets among those that show: a path that loses more is late or slow instead."""
ROUNDS = 3
"""Decodings, each with the innovations' scale and the share of losses of the one before."""
CLEAR_NATS = 3.0
"""A packet shows where the other decision would be worse by this."""
LEAST_NATS, LEAST_LOST = 20.0, 4
"""Packets were lost where saying which makes the log so much more likely, and are so many."""
BY_CHANCE = 0.01
"""Packets are lost however a joint moves: a share that depends on it is a model's error. Of real
losses, this share is taken for one."""
NUDGE_RAD = 4e-3
"""Targets are moved by this to find a response [rad; of a slide a share of its travel]."""
CLIP, FINEST, MOST_MEMORY = 4.5, 0.05, 0.98
"""Residuals count for their memory up to so many medians; innovations have at least this scale
[floors], and residuals live on at most so much."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """What a target that is off for one sample does, of all episodes: T samples, K joints."""

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


@dataclass(frozen=True, kw_only=True)
class Losses:
    """Packets that were lost."""

    groups: Array
    """Joints whose targets are in one packet, (G, K), bool."""
    sizes: tuple[float, float, float]
    """The share that was lost, and the ends of its 90 % interval."""
    nats: float
    chance: float
    """That losses which do not depend on how targets move seem to depend on it so much."""
    lost: tuple[Array, ...]
    """By episode, (T, G), bool."""


def losses(
    world: World, u: Mapping[int, float], residual: Array, before: Losses | None = None
) -> Losses | None:
    """The losses that best explain what a fit leaves (M,); None where none are plausible.

    `before`: losses that the fit knew of; they are decoded on from there.
    """
    evidence = world.evidence
    left = np.zeros(evidence.logged.shape)
    left[evidence.logged] = residual
    flat = np.ascontiguousarray(left.transpose(2, 1, 0).reshape(len(evidence.second), -1))
    found = responses(world, u)
    if not len(found.unit):
        return None
    if before is not None:
        return _decoded(found, flat, before.groups, np.concatenate(before.lost), before.sizes[0])
    alone = np.eye(len(evidence.joints), dtype=bool)
    together = np.ones((1, len(alone)), dtype=bool)
    tried = []
    for groups in (together, *alone[:, None], alone) if len(alone) > 1 else (together,):
        none = np.zeros((found.begins[-1], len(groups)), dtype=bool)
        tried.append(_decoded(found, flat, groups, none, START))
    plausible = (one for one in tried if one is not None)
    return max(plausible, key=lambda one: one.nats, default=None)


def arrived(limb: Limb, lost: Losses) -> Limb:
    """The limb with the commands that arrived: where a packet was lost, the last target stood."""
    commands = []
    for recording, gone in zip(limb.recordings, lost.lost, strict=True):
        rows = np.where(gone, 0, np.arange(len(gone))[:, None])
        command = recording.command.copy()
        for columns, latest in zip(lost.groups, np.maximum.accumulate(rows).T, strict=True):
            command[:, columns] = command[latest][:, columns]
        commands.append(command)
    return limb.with_signals(command=commands)


def _decoded(
    found: Responses, flat: Array, groups: Array, first: Array, share: float
) -> Losses | None:
    lost, left, logged = first, flat, np.asarray(flat.any(axis=0))
    for _ in range(ROUNDS):
        weight, memory = _scale(left, logged)
        price = float(np.log(1.0 / share - 1.0))
        given = found.block, found.template, found.unit, flat, weight, memory
        lost, worth, left = decode(found.command, found.begins, groups, first, price, *given)
        clear = np.abs(worth) >= CLEAR_NATS
        count, clear_count = int(lost[clear].sum()), int(clear.sum())
        share = float(np.clip((count + 0.5) / (clear_count + 1.0), *SHARES))
    share = count / max(clear_count, 1)
    nats = _cost(flat, weight, memory) - _cost(left, weight, memory)
    nats -= price * (int(lost.sum()) - int(first.sum()))
    if count < LEAST_LOST or not SHARES[0] <= share <= SHARES[1]:
        return None
    if nats < LEAST_NATS and not first.any():
        return None
    wide = Z90 * np.sqrt(share * (1 - share) / clear_count)
    return Losses(
        groups=groups,
        sizes=(share, max(share - wide, 0.0), min(share + wide, 1.0)),
        nats=float(nats),
        chance=_chance(found, groups, lost, clear),
        lost=tuple(np.split(lost, found.begins[1:-1])),
    )


def _chance(found: Responses, groups: Array, lost: Array, clear: Array) -> float:
    """See `Losses.chance`.

    By the chi-square test of independence over the signs of the targets' speed and of its change,
    for losses in bursts at the variance of a Markov chain (Anderson and Goodman 1957).
    """
    speed = np.gradient(found.command, axis=0)
    way = np.sign(speed) + 3 * np.sign(np.gradient(speed, axis=0))
    total, freedom = 0.0, 0
    for group, gone, shows in zip(groups, lost.T, clear.T, strict=True):
        share = gone[shows].mean() if shows.any() else 0.0
        spread = share * (1.0 - share)
        if not spread:
            continue
        off = gone[shows] - share
        again = np.clip((off[1:] @ off[:-1]) / (off @ off), 0.0, MOST_MEMORY)
        spread *= (1.0 + again) / (1.0 - again)
        for ways in way[shows][:, group].T:
            of = [off[ways == one] for one in np.unique(ways)]
            total += sum(one.sum() ** 2 / (len(one) * spread) for one in of)
            freedom += len(of) - 1
    return float(chi2.sf(total, freedom)) if freedom else 1.0


def _scale(left: Array, logged: Array) -> tuple[Array, Array]:
    """One over the scale of innovations, and the memory of residuals, by channel (M,)."""
    now, before = left[1:], left[:-1]
    most = np.maximum(CLIP * np.median(np.abs(now), axis=0), FINEST)
    x, y = np.clip(now, -most, most), np.clip(before, -most, most)
    memory = np.clip((x * y).sum(axis=0) / np.maximum((y * y).sum(axis=0), 1e-30), 0, MOST_MEMORY)
    spread = np.median(np.abs(now - memory * before), axis=0) / 0.6745
    return np.where(logged, 1.0 / np.maximum(spread, FINEST), 0.0), memory


def _cost(left: Array, weight: Array, memory: Array) -> float:
    innovations = (left[1:] - memory * left[:-1]) * weight
    return float(np.sum(surprise.py_func(innovations)))


def responses(world: World, u: Mapping[int, float]) -> Responses:
    """The responses of a limb with parameters at u."""
    evidence, limb = world.evidence, world.evidence.limb
    sizes, lengths = np.concatenate(list(map(np.diff, limb.edges))), [e[-1] for e in limb.edges]
    per_block = round(float(np.median(sizes)))
    apart = max(per_block * round(RESPONSE_S / limb.period_s / per_block), 2 * int(sizes.max()))
    window, joints = apart // per_block, len(limb.joints)
    begins, block = np.cumsum([0, *lengths]), np.repeat(np.arange(len(sizes)), sizes)
    row = np.concatenate(list(map(np.arange, lengths)))
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
