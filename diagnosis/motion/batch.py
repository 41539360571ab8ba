"""Worlds side by side on an engine, each under its own targets and loads."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import fields, replace

import numpy as np

from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array, InitialState, State
from diagnosis.motion.recordings import REST_SAMPLES, Recording

Simulate = Callable[[Sequence[Spec]], Simulator]
"""Starts worlds on an engine."""
ASIDE_M, FOREVER_S = (5.0, 0.0, 0.0), 1e6
"""Where the stick floats while joints move in free air, and how long it has no weight [m, s]."""


def read_every(spec: Spec, period_s: float, held: bool = False) -> Spec:
    """A world at the period of its samples; the stick has no weight unless it is held."""
    weightless_s = spec.timing.weightless_s if held else FOREVER_S
    return replace(spec, timing=replace(spec.timing, policy_s=period_s, weightless_s=weightless_s))


def at_rest(joint_rad: Array) -> InitialState:
    """N worlds that rest at joint angles (N, J), the stick aside."""
    count = len(joint_rad)
    return InitialState(
        joint_rad=joint_rad,
        stick_pos_m=np.tile(ASIDE_M, (count, 1)),
        stick_quat_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
    )


def joined(starts: Sequence[InitialState]) -> InitialState:
    """The worlds of all these."""
    names = [field.name for field in fields(InitialState)]
    return InitialState(**{n: np.concatenate([getattr(s, n) for s in starts]) for n in names})


def together(rows: Sequence[Array]) -> Array:
    """Rows of N worlds, shape (T, N, ...): the last one of each is repeated until all end."""
    length = max(map(len, rows))
    return np.stack([one[np.minimum(np.arange(length), len(one) - 1)] for one in rows], axis=1)


def states(
    simulator: Simulator, start: InitialState, target: Array, load: Array, pull: Array | None = None
) -> Generator[State, None, None]:
    """The state of N worlds at every row of targets and loads (T, N, J) and pulls (T, N).

    A state is valid until the next one. The engine is closed at the end.
    """
    loaded, pulled = load.any(), pull is not None and pull.any()
    try:
        yield simulator.reset(start, np.ones(target.shape[1], dtype=bool))
        for k in range(len(target) - 1):
            force = pull[k] if pulled and pull is not None else None
            yield simulator.advance(target[k], load[k] if loaded else None, force)
    finally:
        simulator.close()


def replay(simulate: Simulate, specs: Sequence[Spec], motions: Sequence[Recording]) -> list[Array]:
    """What every world shows of joints and motors: per motion, shape (W, T, 2, J).

    Joints start at the mean of some readings at rest, of the motor where it was logged. The stick
    is out of the way.
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
    worlds = [read_every(s, stride * drive_s) for s in specs for _ in motions]
    starts = at_rest(np.tile(start, (len(specs), 1)))
    every = states(simulate(worlds), starts, target, load)
    shown = np.stack([np.stack([s.measured_rad, s.motor_rad], axis=1) for s in every], axis=1)
    return [shown[k :: len(motions), row] for k, row in enumerate(rows)]
