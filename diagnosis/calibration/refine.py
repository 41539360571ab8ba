"""From where CMA-ES ends to the least error, on linearised replays.

Objectives of joints with play are rough: a candidate a little off floats differently between its
teeth. So the replay is linearised about the gains found, a column per gain, and the paper's sum of
absolute errors is minimised in each of many worlds that differ by a little; their mean is the next
point. Samples that do not go straight with the gains are left out. Rounds end up scattered about
the least error, so the last ones are averaged, and their scatter is a part of the uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.gains import LEAST_SAMPLES, SCALES, Progress, Trace, judge, with_gains
from diagnosis.calibration.robust import least_absolute
from diagnosis.calibration.worlds import Motion, Simulate, replay

ROUNDS, AVERAGED = 5, 3
"""Rounds, and how many of the last are averaged."""
STEP, BENT_RAD = 0.1, 1e-3
"""Change of a gain's logarithm for the differences, and how far off its middle the angle may be."""
LARGEST_STEP = 0.1
"""A round moves the logarithm of a gain by no more."""


@dataclass(frozen=True, kw_only=True)
class Linear:
    """The replays of one joint about some gains, on T samples."""

    trace: Trace
    straight: Array
    """Which of the samples that count are the T, bool."""
    columns: Array
    """Change of the angle with the logarithms of kp and kd [rad], shape (T, 2)."""
    path_rad: Array
    """Angle at these gains [rad], shape (T,)."""
    miss_rad: Array
    """Recorded less replayed angle in worlds that differ by a little [rad], shape (W, T)."""


@dataclass(frozen=True, kw_only=True)
class Refined:
    """Gains of the least error."""

    scale: Array
    """kp and kd over nominal, shape (J, 2)."""
    scatter: Array
    """Relative standard deviation of the rounds that were averaged, shape (J, 2)."""
    linear: dict[int, Linear]
    """The replays about these gains; joints that nearly always float between their teeth lack."""


def refine(
    simulate: Simulate,
    nominal: Spec,
    scale: Array,
    motions: Sequence[Motion],
    joints: Sequence[int],
    rng: np.random.Generator,
    progress: Progress = lambda rounds: None,
) -> Refined:
    """The gains of `joints` from `scale` on, over those of `nominal`, shape (J, 2)."""
    ends = []
    for done in range(ROUNDS):
        linear = linearise(simulate, with_gains(nominal, scale), motions, joints, rng)
        scale = scale.copy()
        for j, found in linear.items():
            steps = [least_absolute(miss, found.columns) for miss in found.miss_rad]
            step = np.clip(np.mean(steps, axis=0), -LARGEST_STEP, LARGEST_STEP)
            scale[j] = np.clip(scale[j] * np.exp(step), *SCALES.T)
        ends.append(np.log(scale))
        progress(done + 1)
    last = np.stack(ends[-AVERAGED:])
    scale = np.exp(last.mean(axis=0))
    world = with_gains(nominal, scale)
    return Refined(
        scale=scale,
        scatter=last.std(axis=0, ddof=1),
        linear=linearise(simulate, world, motions, joints, rng),
    )


def linearise(
    simulate: Simulate,
    world: Spec,
    motions: Sequence[Motion],
    joints: Sequence[int],
    rng: np.random.Generator,
) -> dict[int, Linear]:
    """The replays of `joints` about the gains of `world`."""
    judged, alike = judge(simulate, world, motions, rng)
    specs = [_stepped(world, j, k, sign) for j in joints for k in (0, 1) for sign in (1, -1)]
    shown = replay(simulate, [world, *specs], motions)
    found = {}
    for i, j in enumerate(joints):
        trace = judged[j]
        paths = used(shown, trace, j)
        up, down = paths[1 + 4 * i : 5 + 4 * i : 2], paths[2 + 4 * i : 5 + 4 * i : 2]
        bent = np.abs(up + down - 2 * paths[0]).max(axis=0)
        straight = bent < BENT_RAD
        if straight.sum() < LEAST_SAMPLES:
            continue
        recorded = used([m.read_rad[None] for m in motions], trace, j)
        found[j] = Linear(
            trace=trace,
            straight=straight,
            columns=((up - down).T / (2 * STEP))[straight],
            path_rad=paths[0][straight],
            miss_rad=(recorded - used(alike, trace, j))[:, straight],
        )
    return found


def used(shown: Sequence[Array], trace: Trace, j: int) -> Array:
    """Angles of joint `j` at the samples that count, in each world: shape (W, T)."""
    pairs = zip(shown, trace.used, strict=True)
    return np.concatenate([s[:, trace.channel, rows, j] for s, rows in pairs], axis=1)


def _stepped(world: Spec, j: int, gain: int, sign: int) -> Spec:
    scale = np.ones((len(world.drives), 2))
    scale[j, gain] = np.exp(sign * STEP)
    return with_gains(world, scale)
