"""The size of a gap, and how much each of its residuals counts. Residuals (M,) are in floors."""

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence

MOST_VARIANCE, MOST_CORRELATION = 9.0, 0.95
"""Residuals never count less than with these: a bad fit would else let its priors hold it there."""
TYPICAL, OUTLYING = 6.0, 4.0
"""A residual counts for its joint's variance up to so many medians; one beyond so many root mean
squares counts less and less."""


def squared_gaps(evidence: Evidence, residual: Array) -> Array:
    """Squared gap by joint (K,): the mean over seconds of a second's root mean square, squared.

    All channels of a joint together. What happens once, in one second, does not decide.
    """
    sizes, counts = _seconds(evidence, residual)
    return (sizes.sum(axis=1) / np.maximum((counts > 0).sum(axis=1), 1)) ** 2


def by_second(evidence: Evidence, residual: Array) -> Array:
    """Root mean square of residuals by joint and second (K, S); NaN where there are none."""
    sizes, counts = _seconds(evidence, residual)
    return np.where(counts > 0, sizes, np.nan)[:, counts.any(axis=0)]


def _seconds(evidence: Evidence, residual: Array) -> tuple[Array, Array]:
    """Root mean square of residuals by joint and second, 0 without any, and their counts (K, S)."""
    shape = len(evidence.parts), int(evidence.second[-1]) + 1
    joint = np.repeat(range(shape[0]), [part.stop - part.start for part in evidence.parts])
    cell, size = joint * shape[1] + evidence.seconds, shape[0] * shape[1]
    counts, squares = np.bincount(cell, None, size), np.bincount(cell, residual**2, size)
    return np.sqrt(squares / np.maximum(counts, 1)).reshape(shape), counts.reshape(shape)


def excess(gap2: Array) -> float:
    """What squared gaps (K,) are beyond one floor, over all joints."""
    return float(np.maximum(gap2 - 1.0, 0.0).sum())


def root_weights(evidence: Evidence, residual: Array) -> Array:
    """Square roots of the weights of residuals, (M,).

    A joint's residuals count as many samples as they are independent, with the variance that they
    have: one weight for all channels of a joint, since a channel that fits badly would else count
    less and then fit worse.
    """
    weights = np.zeros_like(residual)
    for part in evidence.parts:
        r = residual[part]
        if not len(r):
            continue
        size = np.abs(r)
        variance = np.mean(np.minimum(size, TYPICAL * np.median(size) + 1e-9) ** 2)
        variance = np.clip(variance, 1.0, MOST_VARIANCE)
        correlation = (r[1:] @ r[:-1]) / (r @ r + 1e-9)
        correlation = np.clip(correlation, 0.0, MOST_CORRELATION)
        outlying = (r / (OUTLYING * np.sqrt(np.mean(r * r) + 1.0))) ** 2
        share = (1 - correlation) / (1 + correlation) / variance
        weights[part] = np.sqrt(share / np.sqrt(1.0 + outlying))
    return weights
