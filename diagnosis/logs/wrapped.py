"""Angles that start again after a turn, as encoders of joints without ends give them."""

from collections.abc import Iterator, MutableMapping, Sequence

import numpy as np
import pandas as pd

from diagnosis.logs.log import name_of

TURN = 2 * np.pi
SLACK = 1e-3
"""Wrapped angles are within a turn and this share of one."""


def unwrap(position: pd.Series, command: pd.Series) -> tuple[pd.Series, pd.Series] | None:
    """A joint's angles [rad] without jumps, and its targets within half a turn of them.

    None where neither is wrapped: no reading jumps by half a turn, and no target that its joint
    turns beyond.
    """
    known = position.dropna()
    if _is_wrapped(known):
        known = pd.Series(np.unwrap(known), known.index)
    elif not _is_wrapped(command.dropna()) or np.ptp(known) <= TURN:
        return None
    turned = known.reindex(position.index)
    near = turned.ffill().bfill()
    return turned, command + TURN * ((near - command) / TURN).round()


def unwrapped(samples: MutableMapping[str, pd.Series], joints: Sequence[str]) -> Iterator[str]:
    """Unwrap the columns of joints [rad] that have both; what was done, in words."""
    for joint in joints:
        at, asked = (name_of(kind, joint, False) for kind in ("position", "command"))
        if at in samples and asked in samples:
            found = unwrap(samples[at], samples[asked])
            if found is not None:
                samples[at], samples[asked] = found
                yield f"{joint} starts again after a turn: its angles are taken on without jumps"


def _is_wrapped(angle: pd.Series) -> bool:
    within = len(angle) > 1 and np.ptp(angle) <= (1.0 + SLACK) * TURN
    return bool(within and (angle.diff().abs() > TURN / 2).any())
