"""Refine the result of CMA-ES to the least error, on linearised replays.

The objective of a joint with play is rough: a slightly different candidate floats differently
between its teeth. So the replay is linearised about the gains found, with a column per gain. The
paper's sum of absolute errors is minimised in each of many slightly different worlds, and the mean
is the next point. Samples that are not linear in the gains are left out. The rounds end up
scattered about the least error. So the last ones are averaged, and their scatter is part of the
uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.gains import LEAST_SAMPLES, SCALES, Progress, Trace, judge, with_gains
from diagnosis.calibration.robust import least_absolute
from diagnosis.calibration.worlds import Motion, replay
from diagnosis.motion.batch import Simulate

ROUNDS, AVERAGED = 5, 3
"""Number of rounds, and how many of the last ones are averaged."""
STEP, CURVED_RAD = 0.1, 1e-3
"""Change of a gain's logarithm for the differences, and the allowed deviation from linearity."""
LARGEST_STEP = 0.1
"""Largest change of the logarithm of a gain in one round."""


@dataclass(frozen=True, kw_only=True)
class Linear:
    """Linearised replays of one joint about given gains, on T samples."""

    trace: Trace
    straight: Array
    """Which of the used samples are the T, bool."""
    columns: Array
    """Derivatives of the angle by the logarithms of kp and kd [rad], shape (T, 2)."""
    path_rad: Array
    """Angle at these gains [rad], shape (T,)."""
    miss_rad: Array
    """Recorded minus replayed angle in slightly different worlds [rad], shape (W, T)."""


@dataclass(frozen=True, kw_only=True)
class Refined:
    """The gains with the least error."""

    scale: Array
    """kp and kd over nominal, shape (J, 2)."""
    scatter: Array
    """Relative standard deviation over the averaged rounds, shape (J, 2)."""
    linear: dict[int, Linear]
    """The replays about these gains; without joints that nearly always float between their
    teeth."""


def refine(
    simulate: Simulate,
    nominal: Spec,
    scale: Array,
    motions: Sequence[Motion],
    joints: Sequence[int],
    rng: np.random.Generator,
    progress: Progress = lambda rounds: None,
) -> Refined:
    """Refine the gains of `joints`, starting at `scale`, over those of `nominal`, shape (J, 2)."""
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
    """The linearised replays of `joints` about the gains of `world`."""
    judged, alike = judge(simulate, world, motions, rng)
    specs = [_stepped(world, j, k, sign) for j in joints for k in (0, 1) for sign in (1, -1)]
    shown = replay(simulate, [world, *specs], motions)
    found = {}
    for i, j in enumerate(joints):
        trace = judged[j]
        paths = used(shown, trace, j)
        up, down = paths[1 + 4 * i : 5 + 4 * i : 2], paths[2 + 4 * i : 5 + 4 * i : 2]
        curved = np.abs(up + down - 2 * paths[0]).max(axis=0)
        straight = curved < CURVED_RAD
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
    """Angles of joint `j` at the used samples, in each world, shape (W, T)."""
    pairs = zip(shown, trace.used, strict=True)
    return np.concatenate([s[:, trace.channel, rows, j] for s, rows in pairs], axis=1)


def _stepped(world: Spec, j: int, gain: int, sign: int) -> Spec:
    scale = np.ones((len(world.drives), 2))
    scale[j, gain] = np.exp(sign * STEP)
    return with_gains(world, scale)
