"""Worlds side by side on an engine, each under its own targets and loads."""

from collections.abc import Iterator, Sequence

import numpy as np

from backends.engine import Simulator
from backends.state import Array, InitialState, State


def together(rows: Sequence[Array]) -> Array:
    """Rows of N worlds, shape (T, N, ...): the last one of each is repeated until all end."""
    length = max(map(len, rows))
    return np.stack([one[np.minimum(np.arange(length), len(one) - 1)] for one in rows], axis=1)


def states(
    simulator: Simulator, start: InitialState, target: Array, load: Array, pull: Array | None = None
) -> Iterator[State]:
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
