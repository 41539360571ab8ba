"""Decoding a limb's lost packets from what it did in a given world.

Every packet that brings a new target may have arrived or been lost; each loss has to pay for being
named, so that losses do not soak up whatever else is unexplained. Errors of a model are smooth in
time and a lost packet is abrupt, so what counts are innovations: what a residual has that the last
one did not predict. Their scale comes from the log, so a badly explained one accuses less.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.beside._packets import MEMORY, SAME, TAIL, decode
from diagnosis.replay.limb import memory, numbers
from diagnosis.replay.replay import Commands, Told, replays

SHARES = (0.005, 0.5)
"""Shares of lost packets that a decoding may assume."""
FINEST = 0.05
"""Innovations have at least this share of a residual's standard deviation."""
AWAKE = 10
"""Innovations are taken within so many samples after a new target."""
CLIP = 4.5
"""Residuals count for their memory up to so many medians."""
DECISIVE_NATS = 8.0
"""A packet is decisive where the opposite decision alone would show by this."""
SHOWN_NATS = 3.0
"""The same of packets by which the share of losses is guessed for the next decoding."""
APART = 16
"""Samples after which a packet's effect has faded: so many runs try the opposite of every one."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How innovations spread."""

    weight: Array
    """One over their scale, (C, J)."""
    memory: Array
    """How much of a residual lives on to the next sample, (C, J)."""


@dataclass(frozen=True, kw_only=True)
class Path:
    """A limb's packets under one hypothesis."""

    world: Spec
    lossy: tuple[str, ...]
    """Joints whose packets may be lost."""
    lost: tuple[Array, ...]
    """Lost packets by recording, each (T,), bool."""
    shown: tuple[Array, ...]
    """What the world then shows by recording, each (T, C, J)."""

    @property
    def lossless(self) -> bool:
        """Whether every packet arrived."""
        return not any(lost.any() for lost in self.lost)


def even(part: Evidence) -> Scale:
    """The scale where a world explains all but noise and the model's floor."""
    weight = 1 / part.sigma[:, 0]
    return Scale(weight=weight, memory=np.zeros_like(weight))


def decoded(
    part: Evidence, world: Spec, lossy: tuple[str, ...], scale: Scale, lost_share: float
) -> Path:
    """The most likely losses where this share of all packets is lost, see `_packets.decode`."""
    price = float(np.log(1 / lost_share - 1))
    done = [_decoded(world, lossy, scale, price, r.commands, r.measured) for r in part.recordings]
    return Path(
        world=world,
        lossy=lossy,
        lost=tuple(lost for lost, _ in done),
        shown=tuple(shown for _, shown in done),
    )


def arrived(part: Evidence, path: Path) -> Evidence:
    """The evidence with the commands that arrived: where one was lost, the last one stood."""
    pairs = zip(part.recordings, path.lost, strict=True)
    recordings = tuple(
        replace(r, commands=_heard(r.commands, part, path.lossy, lost)) for r, lost in pairs
    )
    return replace(part, recordings=recordings)


def _heard(commands: Commands, part: Evidence, lossy: Sequence[str], lost: Array) -> Commands:
    """The commands without those of lossy joints that were lost (T,)."""
    column = [part.joints.index(name) for name in lossy]
    target = commands.target.copy()
    target[:, column] = target[_latest(lost)][:, column]
    return replace(commands, target=target)


def _latest(lost: Array) -> Array:
    """Number of the latest packet that arrived, (T,)."""
    return np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))


def _given(part: Evidence, path: Path, lost: Sequence[Array]) -> Path:
    """A path's world with other losses."""
    pairs = zip(part.recordings, lost, strict=True)
    told = [_heard(r.commands, part, path.lossy, gone) for r, gone in pairs]
    shown = [one[:3].transpose(1, 0, 2) for one in replays(path.world, Told.of(told))]
    return replace(path, lost=tuple(lost), shown=tuple(shown))


def _decoded(
    world: Spec,
    lossy: tuple[str, ...],
    scale: Scale,
    price: float,
    commands: Commands,
    measured: Array,
) -> tuple[Array, Array]:
    """See `_packets.decode`; the world's own losses, noise and steps are left out."""
    limb = numbers(world, 1 << (MEMORY + 1))
    return decode(
        commands.ticks,
        commands.target,
        commands.load,
        commands.start,
        np.ascontiguousarray(measured.transpose(1, 0, 2)),
        np.array([name in lossy for name in world.hand.joint_names]),
        price,
        scale.weight,
        scale.memory,
        limb,
        memory(limb),
    )


def news(part: Evidence, path: Path) -> list[Array]:
    """How far each packet would move the targets of lossy joints, by recording (T, L)."""
    column = [part.joints.index(name) for name in path.lossy]
    found = []
    for recording, lost in zip(part.recordings, path.lost, strict=True):
        target = recording.commands.target[:, column]
        moves = np.zeros_like(target)
        moves[1:] = np.abs(target[1:] - target[_latest(lost)[:-1]])
        found.append(moves)
    return found


def counts(part: Evidence, path: Path) -> tuple[int, int]:
    """Packets that were lost, and those that might have been."""
    said = sum(int((moves > SAME).any(axis=1).sum()) for moves in news(part, path))
    return sum(int(lost.sum()) for lost in path.lost), said


def code(lost: int, said: int) -> float:
    """Nats to say which of the packets were lost."""
    p = (lost + 0.5) / (said + 1.0)
    return float(-lost * np.log(p) - (said - lost) * np.log(1 - p)) if lost else 0.0


def scale_of(part: Evidence, path: Path) -> Scale:
    """The innovations' scale and memory, from samples soon after a new target."""
    now, before = [], []
    for recording, shown in zip(part.recordings, path.shown, strict=True):
        target = recording.commands.target
        moved = np.any(np.diff(target, axis=0, prepend=target[:1]) != 0, axis=1)
        awake = np.convolve(moved, np.ones(AWAKE), "full")[: len(moved)] > 0
        residual = recording.measured.transpose(1, 0, 2) - shown
        now.append(residual[1:][awake[1:]])
        before.append(residual[:-1][awake[1:]])
    a, b = np.concatenate(now), np.concatenate(before)
    sigma = part.sigma[:, 0]
    finest = FINEST * sigma
    if not len(a):
        return even(part)
    logged = np.isfinite(a).any(axis=0)
    a, b = (np.where(logged, v, 0.0) for v in (a, b))
    most = np.maximum(CLIP * np.median(np.abs(a), axis=0), finest)
    x, y = np.clip(a, -most, most), np.clip(b, -most, most)
    memory = np.clip((x * y).sum(axis=0) / np.maximum((y * y).sum(axis=0), 1e-30), 0.0, 0.98)
    spread = np.median(np.abs(a - memory * b), axis=0) / 0.6745
    return Scale(weight=1 / np.maximum(spread, finest), memory=memory)


def decisive(part: Evidence, path: Path, scale: Scale, nats: float = DECISIVE_NATS) -> list[Array]:
    """Packets whose loss would show by itself, and those after a lost one: by recording (T,), bool.

    Judged where all others arrive, so that it does not depend on what was decoded around.
    """
    nothing = [np.zeros_like(lost) for lost in path.lost]
    whole = _given(part, path, nothing)
    moves, found = news(part, whole), nothing
    for phase in range(APART):
        turned = [
            (np.arange(len(move)) % APART == phase) & (move > SAME).any(axis=1) for move in moves
        ]
        other = _given(part, path, turned)
        for k, recording in enumerate(part.recordings):
            logged = np.isfinite(recording.measured).any(axis=1)
            apart = np.where(logged, other.shown[k] - whole.shown[k], 0.0)
            found[k] |= turned[k] & (_ahead(apart, scale) >= nats)
    for clear, lost in zip(found, path.lost, strict=True):
        for k in range(1, len(clear)):
            clear[k] |= clear[k - 1] and lost[k - 1]
    return found


def share_lost(part: Evidence, path: Path, scale: Scale) -> float:
    """Share of losses among packets whose loss shows, as far as decodings may assume it."""
    clear = np.concatenate(decisive(part, path, scale, SHOWN_NATS))
    lost = np.concatenate(path.lost) & clear
    return float(np.clip((lost.sum() + 0.5) / (clear.sum() + 1.0), *SHARES))


def _ahead(apart: Array, scale: Scale) -> Array:
    """Cost [nats] of residuals (T, C, J) within `APART` samples after each, (T,)."""
    e = np.zeros_like(apart)
    e[1:] = (apart[1:] - scale.memory * apart[:-1]) * scale.weight
    cost = (0.5 * (TAIL + 1) * np.log1p(e**2 / TAIL)).sum(axis=(1, 2))
    total = np.concatenate([np.cumsum(cost), np.full(APART, cost.sum())])
    return total[APART:] - total[:-APART]
