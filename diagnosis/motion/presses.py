"""The presses of a push test: a held joint is pushed one way, then let go."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array

SAME_HOLD_RAD = 1e-3
"""Commands that differ by less hold the same position."""


@dataclass(frozen=True, kw_only=True)
class Press:
    """One push of a joint in one direction, from no push to no push, at a constant command."""

    held_rad: float
    """The command."""
    side: int
    """Direction of the push: 0 down, 1 up."""
    pushed: slice
    """Samples from which on it is pushed."""
    released: slice
    """Samples after it, until another push or command."""

    def hard(self, push_nm: Array, share: float) -> Array:
        """Numbers of the samples with at least a share of the press's largest push."""
        size = np.abs(push_nm[self.pushed])
        return self.pushed.start + np.flatnonzero(size >= share * size.max())


def presses(command_rad: Array, push_nm: Array) -> Iterator[Press]:
    """The presses of one joint in an episode, in order, from commands and pushes (T,)."""
    sign = np.sign(push_nm)
    edges = np.flatnonzero(np.diff(sign, prepend=0.0, append=0.0))
    moves = np.flatnonzero(np.diff(command_rad)) + 1
    for start, stop in zip(edges[:-1], edges[1:], strict=True):
        if sign[start] != 0.0 and np.ptp(command_rad[start:stop]) <= SAME_HOLD_RAD:
            later = [*edges[edges > stop], *moves[moves >= stop], len(sign)]
            released = slice(stop, min(later) if stop < len(sign) and sign[stop] == 0.0 else stop)
            yield Press(
                held_rad=float(command_rad[start]),
                side=int(sign[start] > 0),
                pushed=slice(start, stop),
                released=released,
            )


def places(found: Sequence[Press]) -> list[list[int]]:
    """Numbers of presses by the position that was held, where it was pushed in both directions."""
    groups: list[list[int]] = []
    for k in sorted(range(len(found)), key=lambda k: found[k].held_rad):
        if not groups or found[k].held_rad - found[groups[-1][-1]].held_rad > SAME_HOLD_RAD:
            groups.append([])
        groups[-1].append(k)
    return [group for group in groups if {found[k].side for k in group} == {0, 1}]
