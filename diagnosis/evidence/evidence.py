"""What a limb's log says, block by block, in floors: what no model of a robot is right to.

And the size of a gap, by residuals (M,) in floors, and how much each of them counts.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from backends.state import Array
from diagnosis.logs.log import LogError
from diagnosis.motion.columns import LIMIT, STIFFNESS
from diagnosis.motion.limb import BLOCK_S, Limb, block_means
from diagnosis.motion.recordings import stood_s, white_noise
from diagnosis.verdict.result import JointFacts

FLOOR_RAD, FLOOR_SHARE = 2.5e-4, 5e-3
"""No model is right to this: angles [rad; of a slide a share of its travel], and torques as a share
of the largest that is asked for."""
SLOW_S, REST_S = 0.05, 0.3
"""Where samples are further apart, only rests count: targets that stood still for so long [s]."""
SURE_NOISE = 1e-9
"""Torques below this are none [Nm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """One limb's readings in N blocks of K joints, and what they are compared by."""

    limb: Limb
    measured: Array
    """Block means of the readings (N, 3, K); NaN where none count."""
    floor: Array
    """One floor: the model's own error and the noise of a block mean, shape (3, K)."""
    noise: Array
    """White noise of a single reading, shape (3, K)."""
    step: Array
    """Quantisation step of the position sensors [rad], 0: none that shows; shape (K,)."""
    second: Array
    """The second of its episode that a block belongs to, counted through, shape (N,)."""
    size: Array
    """Travel of slides [m], 1 of hinges: the natural size of a joint's angles, shape (K,)."""
    torque: Array
    """Largest torque that is asked of each drive [Nm], shape (K,)."""
    spread: Array | float = 0.0
    """What the nominal world itself cannot predict of each of `readings` [squared floors], (M,)."""

    @cached_property
    def logged(self) -> Array:
        """Where there is a reading that counts, shape (K, 3, N)."""
        return np.isfinite(self.measured).transpose(2, 1, 0)

    @cached_property
    def readings(self) -> Array:
        """All readings that count, in floors: joint by joint, channel by channel, shape (M,)."""
        return self.pack(self.measured)

    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Where each joint's readings are in `readings`."""
        ends = np.cumsum([0, *self.logged.sum(axis=(1, 2))])
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def seconds(self) -> Array:
        """The second of each of `readings`, shape (M,)."""
        return np.broadcast_to(self.second, self.logged.shape)[self.logged]

    @cached_property
    def own_steps(self) -> Array:
        """What the model's own simulator does otherwise (`Recording.own`), as `readings`, (M,)."""
        blocks = np.zeros_like(self.measured)
        own = [recording.own for recording in self.limb.recordings]
        pairs = zip(own, self.limb.edges, strict=True)
        if all(one is not None for one in own):
            means = [block_means(one, edges) for one, edges in pairs if one is not None]
            blocks[:, :2] = np.concatenate(means)[:, None]
        return self.pack(blocks)

    @property
    def only_rests(self) -> bool:
        """Whether the motion between samples is lost, so that only rests count."""
        return self.limb.period_s > SLOW_S

    @property
    def rattles(self) -> bool:
        """Whether play of the nominal world makes some readings unpredictable to a floor."""
        return not self.limb.rigid and bool(np.max(self.spread) > 1.0)

    def pack(self, shown: Array) -> Array:
        """What is shown (N, 3, K) as `readings` are, in floors."""
        return (shown / self.floor).transpose(2, 1, 0)[self.logged] / np.sqrt(1.0 + self.spread)

    def place(self, *joints: int | None) -> JointFacts:
        """What sizes on these joints are said by; None: on all."""
        chosen = [j for j in joints if j is not None] or list(range(len(self.joints)))
        bodies = [self.limb.spec.hand.driven[j] for j in chosen]
        return JointFacts(
            slides=all(body.joint.slides for body in bodies),
            count=float(self.step[chosen].min()),
            mass_kg=bodies[0].mass_kg if len(bodies) == 1 else 0.0,
            ends=bodies[0].joint.range_rad if len(bodies) == 1 else None,
            stiffness=float(self.limb.nominal[chosen[0], STIFFNESS]) if len(bodies) == 1 else 0.0,
            geared=not self.limb.rigid,
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.limb.joints


def evidence(limb: Limb) -> Evidence:
    """A limb's readings with their floors."""
    raw = [r.measured for r in limb.recordings]
    noise = np.median([np.nan_to_num(white_noise(one)) for one in raw], axis=0)
    position = np.concatenate([one[:, 0] for one in raw])
    travel = np.nanmax(position, axis=0) - np.nanmin(position, axis=0)
    step = np.array([quantisation_step(x) for x in position.T])
    slides = np.array([body.joint.slides for body in limb.spec.hand.driven])
    size = np.where(slides, np.maximum(travel, 1e-9), 1.0)
    torque = _torque(limb)
    angle = np.hypot(FLOOR_RAD * size, step / np.sqrt(12.0))
    model = np.stack([angle, angle, FLOOR_SHARE * torque])
    counts = _counts(limb)
    if not counts.any():
        raise LogError(
            f"not identifiable from this log: samples are {1e3 * limb.period_s:.0f} ms apart and "
            f"no target stands still for {REST_S} s, so neither motion nor rests can be judged; "
            f"log every {1e3 * SLOW_S:.0f} ms or faster, or record steps"
        )
    samples = max(1, round(BLOCK_S / limb.period_s))
    seconds = [time_s.astype(int) for time_s in limb.time_s]
    starts = np.cumsum([0, *(s.max() + 1 for s in seconds)])
    return Evidence(
        limb=limb,
        measured=np.where(counts[:, None], limb.measured, np.nan),
        floor=np.hypot(model, noise / np.sqrt(samples)),
        noise=noise,
        step=step,
        second=np.concatenate([a + s for a, s in zip(starts, seconds, strict=False)]),
        size=size,
        torque=torque,
    )


def _torque(limb: Limb) -> Array:
    """Largest torque that the nominal drives ask for, at most half as much again as logged."""
    asked = np.zeros(len(limb.joints))
    for ticks in limb.ticks(limb.nominal):
        if ticks is not None:
            asked = np.maximum(asked, np.abs(ticks[:, 2]).max(axis=0))
    if limb.reads_carried:
        shown = np.nanmax(np.abs(limb.simulate(limb.nominal)[:, 2]), axis=0)
        asked = np.maximum(asked, np.nan_to_num(shown))
    limit = limb.nominal[:, LIMIT]
    return np.maximum(np.minimum(limit, np.where(asked > 0, 1.5 * asked, limit)), SURE_NOISE)


def _counts(limb: Limb) -> Array:
    """Which blocks count, by joint (N, K): all, or rests where motion between samples is lost."""
    shape = len(limb.measured), len(limb.joints)
    if limb.period_s <= SLOW_S:
        return np.ones(shape, dtype=bool)
    found = []
    for recording, edges in zip(limb.recordings, limb.edges, strict=True):
        rests = stood_s(recording.time_s, recording.asked) >= REST_S
        found.append(np.repeat(rests[edges[:-1], None], shape[1], axis=1))
    return np.concatenate(found)


LONGEST = (6.0, 30.0)
"""A step is measured by gaps of readings up to so many steps, then so many: a longer one measures
it better, also where readings were written with few digits, and needs a better one to be counted.
"""


def quantisation_step(readings: Array) -> float:
    """The step of which all readings (T,) are multiples; 0: none that shows."""
    gaps = np.diff(np.unique(np.round(readings[np.isfinite(readings)], 9)))
    gaps = gaps[gaps > 1e-7]
    if len(gaps) < 4:
        return 0.0
    step, near = float(np.median(gaps[gaps < 1.5 * gaps.min()])), gaps
    for most in LONGEST:
        near = gaps[gaps < most * step]
        step = float(near.sum() / np.round(near / step).sum())
    broken = np.abs(near / step - np.round(near / step))
    return step if len(near) > 0.5 * len(gaps) and np.quantile(broken, 0.9) < 0.1 else 0.0


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
    less and then fit worse. What they fall short of a floor is the model's own error, which repeats
    with the motion: else a thousand samples would move all numbers to follow it.
    """
    weights = np.zeros_like(residual)
    for part in evidence.parts:
        r = residual[part]
        if not len(r):
            continue
        size = np.abs(r)
        variance = np.mean(np.minimum(size, TYPICAL * np.median(size) + 1e-9) ** 2)
        correlation = (r[1:] @ r[:-1]) / (r @ r + 1e-9)
        correlation = np.clip(correlation, 0.0, MOST_CORRELATION)
        outlying = (r / (OUTLYING * np.sqrt(np.mean(r * r) + 1.0))) ** 2
        own = correlation if evidence.limb.exact else MOST_CORRELATION
        whole = min(variance, MOST_VARIANCE) * _times(correlation)
        whole += max(1.0 - variance, 0.0) * _times(own)
        weights[part] = 1.0 / np.sqrt(whole * np.sqrt(1.0 + outlying))
    return weights


def _times(correlation: float) -> float:
    """So many samples that are so correlated say as much as one."""
    return (1 + correlation) / (1 - correlation)
