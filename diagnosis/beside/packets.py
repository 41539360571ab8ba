"""Decoding a limb's lost packets from what it did: in the nominal world or one found by replay.

Every packet that brings a new target may have arrived or been lost; each loss has to pay for being
named, so that losses do not soak up whatever else is unexplained. Errors of a model are smooth in
time and a lost packet is abrupt, so what counts are innovations: what a residual has that the last
one did not foretell. Their scale comes from the log, so a badly explained one accuses less.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.evidence import Evidence
from diagnosis.beside._packets import MEMORY, SAME, TAIL, decode
from diagnosis.replay.limb import memory, numbers
from diagnosis.replay.replay import Commands

FIRST_SHARE, SHARES = 0.1, (0.01, 0.5)
"""Share of lost packets that the first decoding assumes, and what later ones may."""
ROUNDS = 2
"""Decodings, each with the share and the innovations of the last."""
FINEST = 0.05
"""Innovations have at least this share of a residual's standard deviation."""
AWAKE = 10
"""Innovations are taken within so many samples after a new target."""
CLIP = 4.5
"""Residuals count for their memory up to so many medians."""
EFFECT_NATS = 15.0
"""A world with another effect must be better by this."""
DECISIVE_NATS = 8.0
"""A packet is decisive where the opposite decision alone would show by this."""
APART = 16
"""Samples after which a packet's effect has faded: so many runs try the opposite of every one."""


Refit = Callable[[Evidence], Spec]
"""The nominal world refitted to evidence."""


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
    nats: float
    """Cost of the innovations, their scale, and of saying which packets were lost."""


@dataclass(frozen=True, kw_only=True)
class Decoding:
    """What a limb's evidence says of its packets, all by one scale."""

    part: Evidence
    scale: Scale
    plain: Path
    """The best world without losses."""
    all: Path
    """Losses of all joints' packets together."""
    single: Path | None
    """Losses of one joint's packets alone; None where there is one joint."""

    def lead(self, path: Path) -> float:
        """How far a path is ahead of none [nats]."""
        return self.plain.nats - path.nats


def decoding(
    part: Evidence,
    worlds: Sequence[Spec],
    explained: Spec | None = None,
    refit: Refit | None = None,
) -> Decoding:
    """Lost packets in a limb's evidence, in whichever world fits them best.

    In nominal `worlds`, in the one that `refit` makes of the commands that arrived, or in
    `explained`, which has effects and must be better by `EFFECT_NATS`.
    """
    every = [*worlds, *([] if explained is None else [explained])]
    apart = [(name,) for name in part.joints] if len(part.joints) > 1 else []

    def cost(tried: tuple[Path, Scale]) -> float:
        return tried[0].nats + EFFECT_NATS * (tried[0].world is explained)

    best = []
    for lossy in (part.joints, *apart):
        tried = [_settled(part, w, lossy, _scale(part, _without(part, w, None))) for w in every]
        best.append(min((*tried, *_relearned(part, lossy, refit)), key=cost))
    scale = max((s for _, s in best), key=lambda s: float(np.log(s.weight).sum()))
    paths = [_path(part, p.world, p.lossy, scale, 0.0, p.lost) for p, _ in best]
    return Decoding(
        part=part,
        scale=scale,
        plain=min((_without(part, w, scale) for w in every), key=lambda p: p.nats),
        all=paths[0],
        single=min(paths[1:], key=lambda p: p.nats, default=None),
    )


def arrived(part: Evidence, path: Path) -> Evidence:
    """The evidence with the commands that arrived: where one was lost, the last one stood."""
    column = [part.joints.index(name) for name in path.lossy]
    recordings = []
    for recording, lost in zip(part.recordings, path.lost, strict=True):
        target = recording.commands.target.copy()
        target[:, column] = target[_latest(lost)][:, column]
        commands = replace(recording.commands, target=target)
        recordings.append(replace(recording, commands=commands))
    return replace(part, recordings=tuple(recordings))


def _latest(lost: Array) -> Array:
    """Number of the latest packet that arrived, (T,)."""
    return np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))


def _relearned(
    part: Evidence, lossy: tuple[str, ...], refit: Refit | None
) -> list[tuple[Path, Scale]]:
    """Losses in the world that is refitted to what they leave of the commands, if there are any.

    A world that is refitted without them bends to make up for them. Where many are lost, what that
    leaves is large and slow, so the first decoding expects noise alone.
    """
    path, _ = first = _settled(part, part.nominal, lossy, _even(part))
    if refit is None or not any(lost.any() for lost in path.lost):
        return [first]
    return [first, _settled(part, refit(arrived(part, path)), lossy, _even(part))]


def _settled(
    part: Evidence, world: Spec, lossy: tuple[str, ...], scale: Scale
) -> tuple[Path, Scale]:
    """Losses decoded by a scale, and again by the scale and share that they leave."""
    path = _path(part, world, lossy, scale, np.log(1 / FIRST_SHARE - 1))
    for _ in range(ROUNDS - 1):
        lost, said = _counts(part, path)
        lost_share = float(np.clip(lost / max(said, 1), *SHARES))
        scale = _scale(part, path)
        path = _path(part, world, lossy, scale, np.log(1 / lost_share - 1))
    return path, scale


def _without(part: Evidence, world: Spec, scale: Scale | None) -> Path:
    """A world without losses."""
    nothing = tuple(np.zeros(len(r.commands.target), dtype=bool) for r in part.recordings)
    return _path(part, world, (), scale or _even(part), 0.0, nothing)


def _even(part: Evidence) -> Scale:
    weight = 1 / part.sigma[:, 0]
    return Scale(weight=weight, memory=np.zeros_like(weight))


def _path(
    part: Evidence,
    world: Spec,
    lossy: tuple[str, ...],
    scale: Scale,
    charge: float,
    given: Sequence[Array] | None = None,
) -> Path:
    """Decoded losses, or those that are `given`."""
    forced = given or [np.full(len(r.commands.target), -1) for r in part.recordings]
    done = [
        _decoded(world, lossy, scale, charge, r.commands, r.measured, f)
        for r, f in zip(part.recordings, forced, strict=True)
    ]
    lost, shown = tuple(d[0] for d in done), tuple(d[1] for d in done)
    path = Path(world=world, lossy=lossy, lost=lost, shown=shown, nats=0.0)
    losses, said = _counts(part, path)
    surprise = sum(d[2] for d in done) - charge * losses + _spread_nats(part, scale)
    return Path(
        world=world, lossy=lossy, lost=lost, shown=shown, nats=surprise + code(losses, said)
    )


def _spread_nats(part: Evidence, scale: Scale) -> float:
    """Cost of the scale itself: what is expected to spread more is less likely to be anywhere."""
    logged = sum(np.isfinite(r.measured).sum(axis=1) for r in part.recordings)
    return -float((logged * np.log(scale.weight)).sum())


def _decoded(
    world: Spec,
    lossy: tuple[str, ...],
    scale: Scale,
    charge: float,
    commands: Commands,
    measured: Array,
    forced: Array,
) -> tuple[Array, Array, float]:
    """See `_packets.decode`; the world's own losses, noise and steps are left out."""
    limb = numbers(world, 1 << (MEMORY + 1))
    return decode(
        commands.ticks,
        commands.target,
        commands.load,
        commands.start,
        np.ascontiguousarray(measured.transpose(1, 0, 2)),
        np.array([name in lossy for name in world.hand.joint_names]),
        charge,
        scale.weight,
        scale.memory,
        limb,
        memory(limb),
        forced.astype(np.int64),
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


def _counts(part: Evidence, path: Path) -> tuple[int, int]:
    """Packets that were lost, and those that might have been."""
    said = sum(int((moves > SAME).any(axis=1).sum()) for moves in news(part, path))
    return sum(int(lost.sum()) for lost in path.lost), said


def code(lost: int, said: int) -> float:
    """Nats to say which of the packets were lost."""
    p = (lost + 0.5) / (said + 1.0)
    return float(-lost * np.log(p) - (said - lost) * np.log(1 - p)) if lost else 0.0


def _scale(part: Evidence, path: Path) -> Scale:
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
        return _even(part)
    logged = np.isfinite(a).any(axis=0)
    a, b = (np.where(logged, v, 0.0) for v in (a, b))
    most = np.maximum(CLIP * np.median(np.abs(a), axis=0), finest)
    x, y = np.clip(a, -most, most), np.clip(b, -most, most)
    memory = np.clip((x * y).sum(axis=0) / np.maximum((y * y).sum(axis=0), 1e-30), 0.0, 0.98)
    spread = np.median(np.abs(a - memory * b), axis=0) / 0.6745
    return Scale(weight=1 / np.maximum(spread, finest), memory=memory)


def decisive(part: Evidence, path: Path, scale: Scale) -> list[Array]:
    """Packets whose loss would show by itself, and those after a lost one: by recording (T,), bool.

    Judged where all others arrive, so that it does not depend on what was decoded around.
    """
    nothing = [np.zeros_like(lost) for lost in path.lost]
    whole = _path(part, path.world, path.lossy, scale, 0.0, nothing)
    moves, found = news(part, whole), nothing
    for phase in range(APART):
        turned = [
            (np.arange(len(move)) % APART == phase) & (move > SAME).any(axis=1) for move in moves
        ]
        other = _path(part, path.world, path.lossy, scale, 0.0, turned)
        for k, recording in enumerate(part.recordings):
            logged = np.isfinite(recording.measured).any(axis=1)
            apart = np.where(logged, other.shown[k] - whole.shown[k], 0.0)
            found[k] |= turned[k] & (_ahead(apart, scale) >= DECISIVE_NATS)
    for clear, lost in zip(found, path.lost, strict=True):
        for k in range(1, len(clear)):
            clear[k] |= clear[k - 1] and lost[k - 1]
    return found


def _ahead(apart: Array, scale: Scale) -> Array:
    """Cost [nats] of residuals (T, C, J) within `APART` samples after each, (T,)."""
    e = np.zeros_like(apart)
    e[1:] = (apart[1:] - scale.memory * apart[:-1]) * scale.weight
    cost = (0.5 * (TAIL + 1) * np.log1p(e**2 / TAIL)).sum(axis=(1, 2))
    total = np.concatenate([np.cumsum(cost), np.full(APART, cost.sum())])
    return total[APART:] - total[:-APART]
