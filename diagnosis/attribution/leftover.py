"""Residual structure of a fit: whether it follows the motion, or one protocol most.

Who stands in for another law leaves residuals that follow the motion: small enough to pass for the
model's own error, and yet the same wherever it comes again. Regressors that a right law has no use
for (Ramsey, J. Royal Statistical Society B 31, 1969) predict them: coefficients from the samples
for fitting then help on those for judging, and the other way round.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backends.state import Array
from diagnosis.attribution.evidence import USED, Evidence, Trace
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.whiten import surprise

SLOW_RAD_S = 0.05
"""A joint that is this slow has hardly a direction."""
FULL = 0.999
"""A drive that gives so much of its torque limit gives all."""
CLEAR = 4.0
"""No innovation counts more than this: a wild sample is no law [standard deviations]."""
RIDGE = 3.0
"""Prior precision of a coefficient, over that of a sample's innovation."""
TORQUE = 0.5
"""What follows the motion counts by so much in a torque, where teeth of other laws show most."""


@dataclass(frozen=True, kw_only=True)
class Leftover:
    """What a fit to all samples leaves."""

    fitter: Fitter
    fit: Fit

    @cached_property
    def lack_of_fit(self) -> float:
        """Cross-validated gain of two regressors, on the channel and joint that is worst [nats].

        Some nats where the effects are right.
        """
        evidence, effects = self.fitter.evidence, self.fitter.effects(self.fit)
        rows = [
            (part, trace, _regressors(trace, limits_nm))
            for part in evidence.settings
            for limits_nm in [np.array([d.torque_limit_nm for d in part.world(effects).drives])]
            for trace in part.traces(effects)
        ]
        channels, _, joints = evidence.sigma.shape
        return max(_foretold(rows, *where) for where in np.ndindex(channels, joints))

    @cached_property
    def unevenness(self) -> float:
        """Whiteness z-score in the worst protocol.

        What shows in one protocol alone is lost among all of them.
        """
        evidence = self.fitter.evidence
        new = self.fitter.innovations(self.fit.effects, self.fit.deviations)
        protocols, tracks = evidence.protocols(), evidence.tracks()
        parts = [protocols == name for name in np.unique(protocols)]
        return max((surprise(new[part], tracks[part]) for part in parts), default=0.0)


def _foretold(rows: Sequence[tuple[Evidence, Trace, Array]], channel: int, joint: int) -> float:
    """What each part of the samples foretells of the other on one channel of one joint [nats].

    By the best two regressors: more of them teach what does not come again. Nothing where all
    samples are for fitting, or all for judging.
    """
    parts = []
    for part, trace, regressors in rows:
        left = trace.left[channel, :, joint]
        signals = np.vstack([left, regressors[:, :, joint] * trace.weight[channel, :, joint]])
        new = part.filtered(np.where(np.isfinite(left), signals, np.nan), channel, joint)
        parts.append(np.vstack([new, trace.judged]))
    table = np.concatenate(parts, axis=1)
    table = table[:, np.isfinite(table[0])]
    new, x, judged = np.clip(table[0], -CLEAR, CLEAR), table[1:-1], table[-1] > 0
    if judged.all() or not judged.any():
        return 0.0
    x = x / (np.sqrt((x**2).mean(axis=1, keepdims=True)) + 1e-12)
    fitted, asked = ((x[:, k] @ x[:, k].T, x[:, k] @ new[k]) for k in (~judged, judged))
    pairs = np.array(list(itertools.combinations(range(len(x)), 2)))
    nats = _taught(pairs, *fitted, *asked) + _taught(pairs, *asked, *fitted)
    return float(nats.max()) * (TORQUE if USED[channel] == "torque" else 1.0)


def _taught(terms: Array, gram: Array, cross: Array, other: Array, asked: Array) -> Array:
    """What regressors `terms` (n, k), fitted to some samples, foretell of others [nats], (n,).

    `gram` (K, K) and `cross` (K,) are the regressors' products with each other and with residuals
    on the one, `other` and `asked` the same on the others.
    """
    rows, columns = terms[:, :, None], terms[:, None, :]
    known = gram[rows, columns] + RIDGE * np.eye(terms.shape[1])
    fit = np.linalg.solve(known, cross[terms][:, :, None])
    taken = np.swapaxes(fit, 1, 2) @ other[rows, columns] @ fit
    return (fit[:, :, 0] * asked[terms]).sum(axis=1) - taken[:, 0, 0] / 2


def _regressors(trace: Trace, limit_nm: Array) -> Array:
    """What forces and sensors may follow on each joint, shape (K, T, J).

    Angle, speed, acceleration, drive torque and outer load, the sizes of these along the motion,
    a constant, the motion's direction, a drive at its limit, and how the other joints move.
    """
    position, _, torque, speed = trace.shown
    faster, load = trace.faster, trace.load
    way, full = np.tanh(speed / SLOW_RAD_S), np.abs(torque) >= FULL * limit_nm
    others = [x.sum(axis=1, keepdims=True) - x for x in (speed, faster)]
    along = [way * np.abs(x) for x in (faster, torque, load)]
    alone = [np.ones_like(speed), way, np.abs(speed), full * np.sign(torque), full * speed]
    return np.stack([position, speed, faster, torque, load, *along, *alone, *others])
