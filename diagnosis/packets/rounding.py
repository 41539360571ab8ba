"""Whether the targets of a joint were rounded on their way to it, and to which step.

Rounding moves a target by a sawtooth. A joint answers so small a move as it answers its targets:
by the response that links them in the replay. So each step predicts what it would leave. A step
that is off slips out of phase over the range of targets, so steps are known sharply. They are tried
evenly in their inverse, all by one Fourier transform over the targets; the best are replayed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.fft
from scipy.signal import lfilter

from backends.state import Array
from diagnosis.models.world import World
from diagnosis.motion.columns import STEP
from diagnosis.motion.limb import BLOCK_S, Limb

RESPONSE_S = 0.16
"""A response is followed for so long [s]: what comes later is slow, and tells of no target."""
STEPS_RAD = 1.2e-3, 0.06
"""Between these ends steps are tried [rad; of a slide, of its travel]."""
ABOVE = 1.5
"""A step is more than so many times the root mean square that it leaves."""
LEAST = 0.2
"""Smaller errors than so many floors are no finding."""
TURNS = 0.2
"""Steps are tried so closely: over all targets they slip by this share of a period."""
FINER = np.linspace(-1.0, 1.0, 11)
"""The best are tried again so closely, of that."""
TRIED, BEST = 16, 3
"""So many steps are tried again, and so many of the best are replayed."""
BINS = 14
"""A period of the least step has so many bins."""
RIDGE = 1e-6
"""Directions of the targets that are so much smaller than the largest tell no response."""
ALIKE = 0.3
"""Share of the squares that the prediction takes at least."""


@dataclass(frozen=True, kw_only=True)
class Rounding:
    """A step to which the targets of a joint were rounded."""

    joint: int
    sizes: tuple[float, float, float]
    """The step, and the ends of what it may be [rad or m]."""


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
    every = (1.0 / step + apart * FINER for step in path.promising(off, *ends, apart))
    tried = [(path.alike(inverse, off), inverse) for inverse in every]
    for score, inverse in sorted(tried, key=lambda one: -one[0].max())[:BEST]:
        if score.max() >= ALIKE:
            best = float(inverse[int(np.argmax(score))])
            low, high = 1.0 / (best + apart / 2), 1.0 / (best - apart / 2)
            yield Rounding(joint=j, sizes=(1.0 / best, low, high))


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
        moved = limb.means(lambda one: one.command[:, joint] - one.command[0, joint])
        rows, sides = list[Array](), list[Array]()
        for own, there in zip(limb.by_episode(moved), limb.by_episode(shown), strict=True):
            past = np.concatenate([np.zeros(lags - 1), own])
            rows.append(np.lib.stride_tricks.sliding_window_view(past, lags)[:, ::-1])
            sides.append(there - there[0])
        response, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(sides), RIDGE)
        target = np.concatenate([r.command[:, joint] for r in limb.recordings])
        edges = np.cumsum([0, *np.concatenate(list(map(np.diff, limb.edges)))])
        return cls(target=target, edges=edges, response=response)

    def promising(self, off: Array, least: float, most: float, apart: float) -> Array:
        """Steps between ends whose sawtooth's first harmonic is most like `off` (N,).

        That is a Fourier coefficient over the targets: of all steps at once, `apart` or less in
        their inverse.
        """
        counts = np.diff(self.edges)
        seen = lfilter(self.response, 1.0, off[::-1])[::-1]
        bins = ((self.target - self.target.min()) / (least / BINS)).astype(int)
        sums = np.bincount(bins, np.repeat(seen / counts, counts))
        length = scipy.fft.next_fast_len(max(len(sums), int(BINS / least / apart) + 1), real=True)
        inverse = np.arange(length // 2 + 1) / (length * least / BINS)
        middle = self.target.min() + least / BINS / 2
        waves = (scipy.fft.rfft(sums, length) * np.exp(-2j * np.pi * inverse * middle)).imag
        tops = 1 + np.flatnonzero((waves[1:-1] >= waves[:-2]) & (waves[1:-1] >= waves[2:]))
        tops = tops[(inverse[tops] >= 1.0 / most) & (inverse[tops] <= 1.0 / least)]
        return np.asarray(1.0 / inverse[tops[np.argsort(-waves[tops])[:TRIED]]])

    def alike(self, inverse: Array, off: Array) -> Array:
        """Signed shares of the squares of `off` (N,) that steps predict, by their inverse (C,)."""
        steps = inverse[:, None]
        saw = np.round(self.target * steps) / steps - self.target
        means = np.add.reduceat(saw, self.edges[:-1], axis=1) / np.diff(self.edges)
        shown = lfilter(self.response, 1.0, means)
        both = shown @ off
        squares = (shown**2).sum(axis=1) * (off @ off)
        return np.asarray(both * np.abs(both) / np.maximum(squares, 1e-300))
