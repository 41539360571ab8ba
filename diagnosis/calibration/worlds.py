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

    Joints start at the mean of some readings at rest, of the motor where it was logged, plus
    `offset_rad` (W, J). The stick is out of the way.
    """
    drive_s = specs[0].timing.drive_s
    ticks = [np.round(m.time_s / drive_s).astype(np.int64) for m in motions]
    stride = int(np.gcd.reduce(np.concatenate([np.diff(t) for t in ticks])))
    rows = [t // stride for t in ticks]
    held = [np.searchsorted(r, np.arange(r[-1] + 1), side="right") - 1 for r in rows]
    target, load = (
        together([getattr(m, name)[at] for m, at in zip(motions, held, strict=True)] * len(specs))
        for name in ("command", "push")
    )
    rests = [m.measured[:REST_SAMPLES, :2].mean(axis=0) for m in motions]
    start = np.stack([np.where(np.isfinite(motor), motor, joint) for joint, motor in rests])
    offset = np.zeros((len(specs), 1)) if offset_rad is None else offset_rad
    aside = {"policy_s": stride * drive_s, "weightless_s": FOREVER_S}
    worlds = [changed(s, timing=changed(s.timing, **aside)) for s in specs for _ in motions]
    starts = at_rest(np.concatenate([start + one for one in offset]))
    every = states(simulate(worlds), starts, target, load)
    shown = np.stack([np.stack([s.measured_rad, s.motor_rad], axis=1) for s in every], axis=1)
    return [shown[k :: len(motions), row] for k, row in enumerate(rows)]
