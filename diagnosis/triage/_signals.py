"""Whether two signals are one motion, and in which units: to check positions by their commands."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array

CLEAR, UNCLEAR = 0.9, 0.5
"""Correlations above and below which two signals certainly are, or are not, the same motion."""
STILL = 1e-6
"""Share of a motion's size below which a signal counts as still."""
UNITS = {"degrees": 180 / np.pi, "turns": 1 / (2 * np.pi), "milliradians": 1e3}
COUNTS = {f"counts of {2**n} per turn": 2**n / (2 * np.pi) for n in range(8, 21)}
"""Units in which an angle may be given, per radian: those that people use, and encoders'."""
LENGTHS = {"millimetres": 1e3, "centimetres": 1e2, "micrometres": 1e6, "inches": 1 / 0.0254}
"""Units in which a length may be given, per metre."""
OPTIONS = {"degrees": "deg", "turns": "turn", "milliradians": "mrad", "millimetres": "mm"}
OPTIONS |= {"centimetres": "cm", "micrometres": "um"}
"""Units that a table may be said to be in, as `--unit` has them."""
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


def centred(episodes: Sequence[Array]) -> Iterator[Array]:
    """Every episode minus its mean, so that offsets do not count."""
    for values in episodes:
        yield values - values.mean()


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Regression of one signal on another: slope and correlation, over all episodes."""

    slope: float
    correlation: float


def line(cause: Sequence[Array], effect: Sequence[Array]) -> Regression:
    """The regression of `effect` on `cause`; the correlation is 0 where either stands still."""
    used = [np.ones((1, len(values)), dtype=bool) for values in effect]
    slope, correlation = regressions([values[None] for values in cause], effect, used)
    return Regression(slope=float(slope[0]), correlation=float(correlation[0]))


def regressions(
    cause: Sequence[Array], effect: Sequence[Array], used: Sequence[Array]
) -> tuple[Array, Array]:
    """Slopes and correlations (L,) of an effect (T,) on causes (L, T) over the samples used (L, T).

    Both are 0 where either stands still, or is not finite.
    """
    xx, yy, xy, count, most = np.zeros((5, len(cause[0])))
    for c, e, u in zip(cause, effect, used, strict=True):
        every = np.maximum(u.sum(axis=1, keepdims=True), 1)
        x, y = (np.where(u, v, 0.0) for v in (c, e))
        most = np.maximum(most, np.abs(x).max(axis=1, initial=0.0))
        x, y = (np.where(u, v - v.sum(axis=1, keepdims=True) / every, 0.0) for v in (x, y))
        xx, yy, xy = xx + (x * x).sum(axis=1), yy + (y * y).sum(axis=1), xy + (x * y).sum(axis=1)
        count = count + u.sum(axis=1)
    moves = (xx > count * (STILL * np.maximum(most, 1e-12)) ** 2) & (yy > 0.0)
    xx, yy, xy = np.where(moves, (xx, yy, xy), ((1.0,), (1.0,), (0.0,)))
    return xy / xx, xy / np.sqrt(xx * yy)
