"""Replay a log's commands in many candidate worlds at once on an engine.

A refit is one batch of worlds that differ in numbers. The engine is passed in, so that any engine
can simulate the nominal world.
"""

from collections.abc import Sequence
from dataclasses import replace as changed

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.motion.batch import FOREVER_S, Simulate, at_rest, states, together
from diagnosis.motion.recordings import CHANNELS, REST_SAMPLES, Recording

READINGS = CHANNELS[:2]
"""Outputs of a replay: readings of the position sensor and angles of the motor."""


def replay(
    simulate: Simulate,
    specs: Sequence[Spec],
    motions: Sequence[Recording],
    offset_rad: Array | None = None,
) -> list[Array]:
    """The readings of every world: per motion, shape (W, T, 2, J) with `READINGS` third.

    Joints start at their position in the log, plus `offset_rad` (W, J).
    """
    drive_s = specs[0].timing.drive_s
    ticks = [np.round(m.time_s / drive_s).astype(np.int64) for m in motions]
    stride = int(np.gcd.reduce(np.concatenate([np.diff(t) for t in ticks])))
    rows = [t // stride for t in ticks]
    held = [np.searchsorted(r, np.arange(r[-1] + 1), side="right") - 1 for r in rows]
    target, load = (
        together([getattr(m, name)[at] for m, at in zip(motions, held, strict=True)])
        for name in ("command", "push")
    )
    offset = np.zeros((len(specs), 1)) if offset_rad is None else offset_rad
    start = np.concatenate([np.stack([_start(m) for m in motions]) + one for one in offset])
    worlds = [_aside(spec, stride) for spec in specs for _ in motions]
    repeated = (np.tile(asked, (1, len(specs), 1)) for asked in (target, load))
    every = states(simulate(worlds), at_rest(start), *repeated)
    shown = np.stack([np.stack([s.measured_rad, s.motor_rad], axis=1) for s in every], axis=1)
    return [shown[k :: len(motions), row] for k, row in enumerate(rows)]


def _start(motion: Recording) -> Array:
    """The mean of some readings at rest (J,), of the motor if it was logged."""
    joint_rad, motor_rad = motion.measured[:REST_SAMPLES, :2].mean(axis=0)
    return np.where(np.isfinite(motor_rad), motor_rad, joint_rad)


def _aside(spec: Spec, stride: int) -> Spec:
    """The world with steps of `stride` drive periods and the stick out of the way."""
    period_s = stride * spec.timing.drive_s
    return changed(spec, timing=changed(spec.timing, policy_s=period_s, weightless_s=FOREVER_S))
