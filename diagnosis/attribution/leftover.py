"""What a fit leaves: whether it follows the motion that it foretells, or one protocol most.

Who stands in for another law leaves residuals that follow the motion: small enough to pass for the
model's own error, and yet the same wherever it comes again. Regressors that a right law has no use
for (Ramsey, J. Royal Statistical Society B 31, 1969) foretell them: coefficients from the samples
for fitting then help on those for judging, and the other way round.
"""

from collections.abc import Iterator, Sequence
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
        """What regressors foretell of it, on the channel and joint that is worst [nats].

        Around zero or less where the effects are right; of torques `TORQUE` of it.
        """
        evidence, effects = self.fitter.evidence, self.fitter.effects(self.fit)
        rows = [
            (part, trace, _regressors(trace, limits_nm))
            for part in evidence.settings
            for limits_nm in [np.array([d.torque_limit_nm for d in part.world(effects).drives])]
            for trace in part.traces(effects)
        ]
        return max((track.nats() for track in _tracks(evidence, rows)), default=0.0)

    @cached_property
    def unevenness(self) -> float:
        """How far from white it is in the worst protocol, see `surprise`.

        What shows in one protocol alone is lost among all of them.
        """
        evidence = self.fitter.evidence
        new = self.fitter.innovations(self.fit.effects, self.fit.deviations)
        protocols, tracks = evidence.protocols(), evidence.tracks()
        parts = [protocols == name for name in np.unique(protocols)]
        return max((surprise(new[part], tracks[part]) for part in parts), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Track:
    """What is new on one channel of one joint."""

    new: Array
    """Innovations, shape (n,)."""
    regressors: Array
    """Filtered as these are, each with a mean square of 1, shape (n, K)."""
    judged: Array
    """Which samples judge, shape (n,), bool."""
    counted: float
    """By how much it counts."""

    def nats(self) -> float:
        """What each part of the samples foretells of the other."""
        both = (self.judged, ~self.judged)
        return self.counted * sum(self._foretold(~part, part) for part in both)

    def _foretold(self, known: Array, asked: Array) -> float:
        x, new = self.regressors[known], self.new[known]
        fit = np.linalg.solve(x.T @ x + RIDGE * np.eye(x.shape[1]), x.T @ new)
        left = self.new[asked] - self.regressors[asked] @ fit
        return float(self.new[asked] @ self.new[asked] - left @ left) / 2


def _tracks(evidence: Evidence, rows: Sequence[tuple[Evidence, Trace, Array]]) -> Iterator[Track]:
    """Every channel of every joint that has samples of both kinds."""
    channels, _, joints = evidence.sigma.shape
    for channel, joint in np.ndindex(channels, joints):
        parts = []
        for part, trace, regressors in rows:
            left = trace.left[channel, :, joint]
            signals = np.vstack([left, regressors[:, :, joint] * trace.weight[channel, :, joint]])
            new = part.filtered(np.where(np.isfinite(left), signals, np.nan), channel, joint)
            parts.append(np.vstack([new, trace.judged]))
        table = np.concatenate(parts, axis=1)
        table = table[:, np.isfinite(table[0])]
        judged, x = table[-1] > 0, table[1:-1].T
        if judged.any() and not judged.all():
            yield Track(
                new=np.clip(table[0], -CLEAR, CLEAR),
                regressors=x / (np.sqrt((x**2).mean(axis=0)) + 1e-12),
                judged=judged,
                counted=TORQUE if USED[channel] == "torque" else 1.0,
            )


def _regressors(trace: Trace, limit_nm: Array) -> Array:
    """What forces and sensors may follow on each joint, shape (K, T, J).

    Angle, speed, acceleration, drive torque and outer load, the sizes of these along the motion,
    a drive at its limit, and how the other joints move.
    """
    position, _, torque, speed = trace.shown
    faster, load = trace.faster, trace.load
    way, full = np.tanh(speed / SLOW_RAD_S), np.abs(torque) >= FULL * limit_nm
    others = [x.sum(axis=1, keepdims=True) - x for x in (speed, faster)]
    along = [way * np.abs(x) for x in (faster, torque, load)]
    alone = [np.ones_like(speed), way, np.abs(speed), full * np.sign(torque), full * speed]
    return np.stack([position, speed, faster, torque, load, *along, *alone, *others])
