"""Whether two signals are one motion, and in which units: to check positions by their commands."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.logs import roles

CLEAR, UNCLEAR = 0.9, 0.5
"""Correlations above and below which two signals certainly are, or are not, the same motion."""
STILL = 1e-6
"""Share of a motion's size below which a signal counts as still."""
OPTIONS = {"degrees": "deg", "turns": "turn", "milliradians": "mrad"}
OPTIONS |= {"millimetres": "mm", "centimetres": "cm", "micrometres": "um"}
"""Units that a table may be said to be in, as `--unit` has them."""
UNITS = {name: roles.ANGLES[unit] for name, unit in OPTIONS.items() if unit in roles.ANGLES}
COUNTS = {f"counts of {2**n} per turn": 2**n * UNITS["turns"] for n in range(8, 21)}
"""Units in which an angle may be given, per radian: those that people use, and encoders'."""
LENGTHS = {name: roles.LENGTHS[unit] for name, unit in OPTIONS.items() if unit in roles.LENGTHS}
LENGTHS |= {"inches": 1 / 0.0254}
"""Units in which a length may be given, per metre."""
NEAR = 0.12
"""Largest relative distance of a scale from that of a unit."""


def unit(scale: float, slides: bool) -> tuple[str, str] | None:
    """The side, position or command, that a scale puts in another unit, and that unit."""
    for name, size in (LENGTHS if slides else UNITS | COUNTS).items():
        for side, expected in (("position", size), ("command", 1 / size)):
            if abs(np.log(scale / expected)) < NEAR:
                return side, name
    return None


def rms(values: Array) -> float:
    """Root mean square; 0 of no values."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Regression of one signal on another: slope and correlation, over all episodes."""

    slope: float = 0.0
    correlation: float = 0.0


def line(cause: Sequence[Array], effect: Sequence[Array]) -> Regression:
    """The regression of `effect` on `cause`, each episode about its mean: offsets do not count.

    Both numbers are 0 where either stands still, or is not finite, and where they are of other
    pieces of a log.
    """
    if list(map(len, cause)) != list(map(len, effect)):
        return Regression()
    x, y = (np.concatenate([v - v.mean() for v in signal]) for signal in (cause, effect))
    most = max(float(np.abs(v).max()) for v in cause)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    moves = xx > len(x) * (STILL * max(most, 1e-12)) ** 2 and yy > 0.0
    return Regression(slope=xy / xx, correlation=xy / np.sqrt(xx * yy)) if moves else Regression()
