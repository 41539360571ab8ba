"""Whether the targets of a joint were rounded on their way to it, and to which step.

Rounding moves a target by a sawtooth. A joint answers so small a move as it answers its targets:
by the response that links them in the replay. So each step predicts what it would leave. A step
that is off slips out of phase over the range of targets, so they are tried evenly in their inverse
and known sharply; the best are replayed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from backends.state import Array
from diagnosis.models.world import World
from diagnosis.motion.columns import STEP
from diagnosis.motion.limb import BLOCK_S, Limb, block_means

RESPONSE_S = 0.16
"""A response is followed for so long [s]."""
STEPS_RAD = 1.2e-3, 0.06
"""Between these ends steps are tried [rad; of a slide, of its travel]."""
ABOVE = 1.5
"""A step is more than so many times the root mean square that it leaves."""
LEAST = 0.2
"""Smaller errors than so many floors are no finding."""
TURNS = 0.2
"""Steps are tried so closely: over all targets they slip by this share of a period."""
FINER = np.linspace(-1.0, 1.0, 21)
"""The best are tried again so closely, of that."""
CHUNK, TRIED, BEST = 64, 8, 3
"""So many steps are tried at a time, so many tried again, and so many of the best are replayed."""
RIDGE = 1e-6
"""Directions of the targets that are so much smaller than the largest tell no response."""
ALIKE = 0.3
"""Share of the squares that the prediction takes at least."""


@dataclass(frozen=True, kw_only=True)
class Rounding:
    """A step to which the targets of a joint were rounded."""

    joint: int
    step: float
    """[rad or m]; so are the ends of what it may be."""
    low: float
    high: float


def roundings(world: World, u: Mapping[int, float], residual: Array) -> Iterator[Rounding]:
    """Steps that may explain what a fit leaves (M,), the likeliest first, by joint.

    None of a joint whose nominal path is stepped already.
    """
    evidence, limb = world.evidence, world.evidence.limb
    left = np.zeros(evidence.logged.shape)
    left[evidence.logged] = residual
    shown: Array | None = None
    for j in range(len(evidence.joints)):
        off = left[j, 0] * evidence.floor[0, j]
        size = float(np.sqrt(np.mean(off**2)))
        if limb.nominal[j, STEP] > 0.0 or size < LEAST * evidence.floor[0, j]:
            continue
        shown = world.blocks(u) if shown is None else shown
        low, high = (end * evidence.size[j] for end in STEPS_RAD)
        yield from _steps(limb, j, off, shown[:, 0, j], (max(low, ABOVE * size), high))


def _steps(
    limb: Limb, j: int, off: Array, shown: Array, ends: tuple[float, float]
) -> Iterator[Rounding]:
    """Steps between ends of a joint whose position is off (N,) where a replay shows (N,) [rad]."""
    path = _Path.of(limb, j, shown)
    apart = TURNS / max(float(np.abs(path.target).max()), ends[1])
    tried = np.arange(1.0 / ends[1], 1.0 / ends[0], apart)
    if not len(tried):
        return
    scores = np.concatenate(
        [path.alike(tried[k : k + CHUNK], off) for k in range(0, len(tried), CHUNK)]
    )
    tops = np.flatnonzero((scores >= np.roll(scores, 1)) & (scores >= np.roll(scores, -1)))
    best = sorted(tops, key=lambda k: -scores[k])[:TRIED]
    finer = [(path.alike(near, off), near) for near in (tried[k] + apart * FINER for k in best)]
    for score, near in sorted(finer, key=lambda one: -one[0].max())[:BEST]:
        if score.max() >= ALIKE:
            inverse = near[int(np.argmax(score))]
            low, high = 1.0 / (inverse + apart / 2), 1.0 / (inverse - apart / 2)
            yield Rounding(joint=j, step=1.0 / inverse, low=low, high=high)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Path:
    """The targets of one joint in all episodes, and its response to them by block."""

    target: Array
    """[rad], shape (T,)."""
    edges: Array
    """First samples of the blocks, and the end, shape (N + 1,)."""
    response: Array
    """What a block's target does to the positions of this and later blocks, shape (L,)."""

    @classmethod
    def of(cls, limb: Limb, joint: int, shown: Array) -> "_Path":
        """See `_Path`; by least squares of a replay's positions (N,)."""
        lags = max(2, round(RESPONSE_S / max(BLOCK_S, limb.period_s)))
        begin, rows, sides, edges, samples = 0, list[Array](), list[Array](), list[Array](), 0
        for recording, own in zip(limb.recordings, limb.edges, strict=True):
            moved = block_means(recording.command[:, joint] - recording.command[0, joint], own)
            past = np.concatenate([np.zeros(lags - 1), moved])
            rows.append(np.lib.stride_tricks.sliding_window_view(past, lags)[:, ::-1])
            sides.append(shown[begin : begin + len(moved)] - shown[begin])
            edges.append(own[:-1] + samples)
            begin, samples = begin + len(moved), samples + len(recording.command)
        response, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(sides), RIDGE)
        target = np.concatenate([r.command[:, joint] for r in limb.recordings])
        return cls(
            target=target, edges=np.append(np.concatenate(edges), samples), response=response
        )

    def alike(self, inverse: Array, off: Array) -> Array:
        """Signed shares of the squares of `off` (N,) that steps predict, by their inverse (C,)."""
        steps = inverse[:, None]
        saw = np.round(self.target * steps) / steps - self.target
        means = np.add.reduceat(saw, self.edges[:-1], axis=1) / np.diff(self.edges)
        shown = lfilter(self.response, 1.0, means, axis=1)
        both = shown @ off
        squares = (shown**2).sum(axis=1) * (off @ off)
        return np.asarray(both * np.abs(both) / np.maximum(squares, 1e-300))
