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
    x, y = (np.concatenate(list(centred(part))) for part in (cause, effect))
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return Regression(slope=0.0, correlation=0.0)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    size = max(float(np.abs(np.concatenate(cause)).max()), 1e-12)
    if xx <= len(x) * (STILL * size) ** 2 or yy <= 0.0:
        return Regression(slope=0.0, correlation=0.0)
    return Regression(slope=xy / xx, correlation=xy / np.sqrt(xx * yy))


def correlations(cause: Sequence[Array], effect: Sequence[Array], used: Sequence[Array]) -> Array:
    """Correlations of causes (L, T) and one effect (T,) over the samples used (L, T), as `line`."""
    xx, yy, xy, count, most = np.zeros((5, len(cause[0])))
    for c, e, u in zip(cause, effect, used, strict=True):
        every = np.maximum(u.sum(axis=1, keepdims=True), 1)
        x, y = (np.where(u, v, 0.0) for v in (c, e))
        most = np.maximum(most, np.abs(x).max(axis=1, initial=0.0))
        x, y = (np.where(u, v - v.sum(axis=1, keepdims=True) / every, 0.0) for v in (x, y))
        xx, yy, xy = xx + (x * x).sum(axis=1), yy + (y * y).sum(axis=1), xy + (x * y).sum(axis=1)
        count = count + u.sum(axis=1)
    still = (xx <= count * (STILL * np.maximum(most, 1e-12)) ** 2) | (yy <= 0.0)
    found = np.where(still, 0.0, xy / np.sqrt(np.where(still, 1.0, xx * yy)))
    return np.nan_to_num(found, nan=0.0)
