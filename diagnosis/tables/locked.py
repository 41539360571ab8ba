"""A gear whose output is locked while its motor presses to and fro: its hysteresis curve.

The lost motion is how far apart the positions are at a small torque of either sign, in the middle
between the ways up and down. Friction is half of what the torques of the two ways differ by where
the position is in the middle. The stiffness is a chord: from the small torque to the largest.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks
from scipy.stats import t as student

from diagnosis.logs.log import LogError
from diagnosis.tables.joints import Rows
from diagnosis.tables.terms import Term

REVERSAL = 0.05
"""A reversal changes the torque by so large a share of its range."""
SMOOTH_S = 0.05
"""Noise of the torque is taken out over so long a time."""
EVEN = 0.5
"""A way goes to and fro where the nearer of its ends is so large a share of the farther."""
AT = 0.75
"""The lost motion is that at so large a share of the smallest sweep's torque, ..."""
NEAR = 0.1
"""Rows have a torque that is off by no more than such a share of it."""
SMALL = 1.5
"""... and sweeps that reach up to so many times the smallest count."""


@dataclass(frozen=True, kw_only=True)
class Way:
    """Rows between two reversals of the torque, which rises or falls."""

    torque: np.ndarray
    position: np.ndarray

    @property
    def up(self) -> bool:
        """Whether the torque rises."""
        return bool(self.torque[-1] > self.torque[0])

    @property
    def ends(self) -> tuple[float, float]:
        """How far the torque is from zero at its ends, the nearer first; negative: on one side."""
        first, last = self.torque[[0, -1]]
        near, far = sorted((abs(first), abs(last)))
        return (near if first * last < 0.0 else -near), far

    def position_at(self, torque: float) -> float:
        """Where it is while it has about a torque, on average; NaN: it does not reach it."""
        near = np.abs(self.torque - torque) < NEAR * abs(torque)
        return float(self.position[near].mean()) if near.any() else np.nan

    def torque_at(self, position: float) -> float:
        """What presses while it passes a position, on average; NaN: it does not come there."""
        past = np.flatnonzero(np.diff(np.sign(self.position - position)))
        return float(self.torque[past].mean()) if len(past) else np.nan


def hysteresis(one: Rows) -> tuple[list[Term], float]:
    """Lost motion, friction and stiffness of a joint, and the torque of the lost motion.

    Raises LogError for torques that do not go to and fro.
    """
    ways = list(_ways(one))
    through = [way for way in ways if way.ends[0] > EVEN * way.ends[1]]
    if not {way.up for way in through} == {True, False}:
        raise LogError(
            f"the torque of {one.joint} does not go to and fro: press about as far to both sides, "
            "twice or more, while the output is locked"
        )
    smallest = min(way.ends[0] for way in through)
    least = [way for way in through if way.ends[1] <= SMALL * smallest]
    at = AT * smallest
    middle = np.nanmean([way.position_at(side * at) for side in (1, -1) for way in least])
    sides = [(way, 1.0 if way.up else -1.0) for way in least]
    found = {
        "lost motion": [way.position_at(at) - way.position_at(-at) for way in least],
        "friction": [side * way.torque_at(float(middle)) for way, side in sides],
        "stiffness": [_chord(way, at) for way in through if way.ends[0] > 2 * at],
    }
    return list(_terms(one.joint, found)), at


def _ways(one: Rows) -> Iterator[Way]:
    """The rows between reversals of the torque."""
    position, count = one.rows["position"].to_numpy(), len(one.rows)
    rows = max(int(SMOOTH_S * count / np.ptp(one.rows["time_s"])), 1)
    smooth = one.rows["torque"].rolling(rows, center=True, min_periods=1).median()
    torque = smooth.to_numpy()
    least = REVERSAL * np.ptp(torque)
    turns = [k for side in (1, -1) for k in find_peaks(side * torque, prominence=least)[0]]
    for first, last in zip([0, *sorted(turns)], [*sorted(turns), len(torque) - 1], strict=True):
        if abs(torque[last] - torque[first]) > least:
            part = slice(first, last + 1)
            yield Way(torque=torque[part], position=position[part])


def _chord(way: Way, at: float) -> float:
    """How much torque a position takes, on the way from a small torque to that of its end."""
    side = np.sign(way.torque[-1])
    moved = way.position[-1] - way.position_at(side * at)
    return float((way.torque[-1] - side * at) / moved) if moved else np.nan


def _terms(joint: str, found: Mapping[str, Sequence[float]]) -> Iterator[Term]:
    """The means over ways, and their 90 % intervals, of what two ways or more show."""
    for name, values in found.items():
        known = np.array([value for value in values if np.isfinite(value)])
        if len(known) > 1:
            wide = student.ppf(0.95, len(known) - 1) * known.std(ddof=1) / np.sqrt(len(known))
            mean = float(known.mean())
            yield Term(joint=joint, term=name, value=mean, low=mean - wide, high=mean + wide)
