"""What is drawn at random for every episode: its start, its heading, its noise, where it is cut."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from backends.spec import Spec
from backends.state import Array, InitialState
from tasks.initial_states import sample_initial_states

STARTS_PER_WORLD = 8
"""Number of initial states from which each world draws its episodes."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The draws of an episode of each of N worlds."""

    start: InitialState
    heading_rad: Array
    """Heading of the figure [rad], shape (N,)."""
    cut: Array
    """Step at which a staggered episode is cut, shape (N,)."""


class Draws(Protocol):
    """Streams of draws."""

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """New episodes for the masked worlds; the rows of others mean nothing.

        `start` replaces the drawn initial states.
        """
        ...


class SharedDraws:
    """One stream for all worlds."""

    def __init__(self, specs: Sequence[Spec], seed: int, spread: float, horizon: int) -> None:
        self._specs, self._spread, self._horizon = specs, spread, horizon
        self._rng = np.random.default_rng(seed)
        self._noise_rng = np.random.default_rng([seed, 1])
        self._starts: list[InitialState] = []

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """See `Draws.episodes`; draws for all worlds, whatever the mask."""
        worlds = len(self._specs)
        start = self._start() if start is None else start
        heading = self._rng.uniform(0, 2 * math.pi, worlds)
        cut = self._rng.integers(1, self._horizon + 1, worlds)
        noise = self._noise_rng.integers(1 << 53, size=worlds)
        return Drawn(start=replace(start, noise_seed=noise), heading_rad=heading, cut=cut)

    def _start(self) -> InitialState:
        if not self._starts:
            self._starts = [
                sample_initial_states(self._specs, self._rng, self._spread)
                for _ in range(STARTS_PER_WORLD)
            ]
        return self._starts[self._rng.integers(STARTS_PER_WORLD)]


class OwnDraws:
    """A stream per world: an episode does not hang on the other worlds."""

    def __init__(
        self, specs: Sequence[Spec], seeds: Sequence[int], spread: float, horizon: int
    ) -> None:
        pairs = zip(specs, seeds, strict=True)
        self._worlds = [SharedDraws([spec], seed, spread, horizon) for spec, seed in pairs]

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """See `Draws.episodes`."""
        one = np.ones(1, dtype=bool)
        drawn = {
            i: self._worlds[i].episodes(one, None if start is None else _row(start, i))
            for i in np.flatnonzero(mask).tolist()
        }

        def rows(parts: dict[int, Array]) -> Array:
            first = next(iter(parts.values()))
            whole = np.zeros((len(self._worlds), *first.shape[1:]), first.dtype)
            for i, part in parts.items():
                whole[i] = part[0]
            return whole

        names = [field.name for field in fields(InitialState)]
        starts = {n: rows({i: getattr(d.start, n) for i, d in drawn.items()}) for n in names}
        return Drawn(
            start=InitialState(**starts),
            heading_rad=rows({i: d.heading_rad for i, d in drawn.items()}),
            cut=rows({i: d.cut for i, d in drawn.items()}),
        )


def _row(start: InitialState, world: int) -> InitialState:
    rows = {f.name: getattr(start, f.name)[[world]] for f in fields(start)}
    return InitialState(**rows)
