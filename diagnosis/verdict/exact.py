"""Evidence in nats, where the law is exact: a simulator with ours leaves the noise and no more.

There, and only there, likelihoods say what shares cannot see: causes whose gap is below a floor.
A robot's log is never judged by this: no model of it is exact, so every wrong cause would win.
"""

from collections.abc import Sequence

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import FLOOR_RAD, Evidence
from diagnosis.search.fit import Fit, costs
from diagnosis.verdict.ordinary import SHAPE_LAW

ACCUSE_NATS = 10.0
"""A cause is worth it where it makes the log so much more likely."""
LEAST = 0.05
"""Residuals have at least this root mean square [floors]: logs without noise say no more."""
COMPANION_NATS = 60.0
"""What stands for an integrator's difference wins less: 25 on fingers drawn for it, where true
second causes win 100 and more."""
TIE_NATS = 6.0
"""Causes are tied that are no further behind."""
MOST_CORRELATION = 0.98
COARSE = 4.0
"""Steps of a sensor beyond so many model floors are no noise: they repeat with the motion, so its
residuals count as little as the most correlated ones."""


def weights(evidence: Evidence, residual: Array) -> Array:
    """Root weights (M,) of residuals that are noise: by joint, with the variance that they have."""
    found = np.zeros_like(residual)
    coarse = evidence.step > COARSE * FLOOR_RAD * evidence.size
    for part, steps in zip(evidence.parts, coarse, strict=True):
        r = residual[part]
        if len(r):
            correlation = np.clip(r[1:] @ r[:-1] / (r @ r + 1e-12), 0.0, MOST_CORRELATION)
            correlation = MOST_CORRELATION if steps else correlation
            share = (1 - correlation) / (1 + correlation)
            found[part] = np.sqrt(share / max(np.mean(r * r), LEAST**2))
    return found


def is_likely(evidence: Evidence, fit: Fit, before: Sequence[Fit], nominal: Fit) -> bool:
    """Whether a set of causes makes a log much more likely than each with one cause less.

    Those leave more than noise, for engines integrate otherwise: as much as a law is off by of
    what it explains (`ordinary.SHAPE_LAW`). So a further cause wins that share of theirs, or more
    than such a companion can.
    """
    own, bare, *less = costs(evidence, [fit, nominal, *before], weights)
    law = min(SHAPE_LAW**2 * (bare - min(less)), COMPANION_NATS)
    return min(less) - own >= max(ACCUSE_NATS, law)


def ranked(evidence: Evidence, fits: Sequence[Fit]) -> list[tuple[float, Fit]]:
    """Fits with their costs [nats], the likeliest first: all by the noise that the best leaves."""
    every = zip(costs(evidence, fits, weights), fits, strict=True)
    return sorted(every, key=lambda pair: pair[0])
