"""How far a gap shrinks, with intervals over held-out samples."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backends.state import Array

BLOCK, BLOCKS, RESAMPLES = 50, 8, 400
"""Samples that are resampled together, for intervals over held-out samples: no more of them than
leave so many blocks; and how often."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share, or a gap, with its 90 % interval."""

    value: float
    interval: tuple[float, float]


def shrinkage(before: Array, after: Array, seed: int = 0) -> Share:
    """Share of the squared gap above the noise that is gone, from squared held-out residuals."""
    return _resampled(_gone, (before, after), seed)


def gap(squares: Array, seed: int = 0) -> Share:
    """Root mean square over the noise, from squared held-out residuals."""
    return _resampled(np.sqrt, (squares,), seed)


def _resampled(of: Callable[..., float], squares: tuple[Array, ...], seed: int) -> Share:
    """A function of the means of squares, with the interval that resampled blocks give."""
    size = min(BLOCK, max(len(squares[0]) // BLOCKS, 1))
    count = len(squares[0]) // size
    blocks = [v[: count * size].reshape(count, size).mean(axis=1) for v in squares]
    draws = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    resampled = [of(*(b[d].mean() for b in blocks)) for d in draws]
    low, high = np.percentile(resampled, [5, 95])
    value = of(*(v.mean() for v in squares))
    return Share(value=float(value), interval=(float(low), float(high)))


def _gone(before: float, after: float) -> float:
    excess = before - 1.0
    return float(1 - max(after - 1.0, 0.0) / excess) if excess > 1e-9 else 0.0
