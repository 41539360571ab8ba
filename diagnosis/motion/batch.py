"""Worlds side by side on an engine, each under its own targets and loads."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import fields

import numpy as np

from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array, InitialState, State

Simulate = Callable[[Sequence[Spec]], Simulator]
"""Starts worlds on an engine."""
ASIDE_M, FOREVER_S = (5.0, 0.0, 0.0), 1e6
"""Where the stick floats while joints move in free air, and how long it has no weight [m, s]."""


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
