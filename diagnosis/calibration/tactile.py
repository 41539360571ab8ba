"""Tactile calibration from readings without contact: offset, threshold, drift, dead taxels.

As in the paper, the offset of a taxel is the mean of its readings without contact. The reading
minus the offset is compared with one fixed threshold:

    s(t) = max(s_raw(t) - offset, 0),        in contact where s(t) > threshold
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat
from scipy.ndimage import correlate

from backends.state import Array
from diagnosis.logs.log import Log
from diagnosis.motion.held import PROTOCOLS
from diagnosis.motion.recordings import FREE_AIR

NOISES = 5.0
"""The threshold is this many standard deviations of the noise above the offset."""
PIECES = 20
"""Drift is fitted to the means of this many pieces of an episode, because neighbouring samples are
alike."""
LEAST_SAMPLES = 50
SURE = 3.0
"""A slope counts as drift from this many standard deviations on."""
SURROUNDED, WITNESSES = 0.75, 5
"""A taxel is dead if it never responds and is silent in this many samples with this share of its
neighbours in contact."""
NO_READINGS = (
    "not identifiable from this log: no episode in free air has touch readings; log some seconds "
    "of touch without contact"
)


def _rounded(value: float) -> float:
    """Five digits of a number."""
    return float(f"{float(value):.5g}")


Number = Annotated[FiniteFloat, AfterValidator(_rounded)]
Size = Annotated[Number, Field(ge=0)]


class Part(BaseModel):
    """A part of calibration.yaml."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class TouchSensor(Part):
    """The taxels of one finger, in the unit of their readings: m, or 1 for contact or none."""

    threshold: Size
    """A reading that is further above the offset than this counts as contact."""
    false_share: Annotated[Number, Field(ge=0, le=1)]
    """Share of the readings without contact that would count as contact."""
    fastest_drift_s: Size
    """Largest significant upward slope [unit/s]; 0 if there is none."""
    dead: tuple[int, ...]
    """Taxels that stay silent while their neighbours are in contact."""
    touched: int
    """Number of taxels that were in contact or are dead; of the others only the rest is known."""
    offset: tuple[Number, ...]
    """Mean reading of every taxel without contact."""
    noise: tuple[Size, ...]
    """Standard deviation about offset and drift."""
    drift_s: tuple[Number, ...]
    """Slope of the readings without contact [unit/s]."""
    drift_std_s: tuple[Size, ...]
    """Its standard deviation [unit/s]."""


def binarise(reading: Array, offset: Array, threshold: float) -> Array:
    """Whether taxels (..., T) are in contact."""
    return np.maximum(reading - offset, 0.0) > threshold


def calibrate_touch(
    log: Log, grid: tuple[int, int] | None, threshold: float | None = None
) -> dict[str, TouchSensor] | str:
    """The touch sensor of every finger, or why it is not identifiable from this log.

    `grid` holds the rows and columns of the taxels; without it no dead taxel is found. `threshold`
    replaces the one computed from the noise.
    """
    quiet = _episodes(log, FREE_AIR)
    if sum(len(time_s) for time_s, _ in quiet) < LEAST_SAMPLES:
        return NO_READINGS
    pressed = _episodes(log, PROTOCOLS)
    found = {}
    for f, finger in enumerate(log.fingers):
        rest = [(time_s, touch[:, f]) for time_s, touch in quiet]
        press = [touch[:, f] for _, touch in pressed]
        found[finger] = _finger(rest, press, grid, threshold)
    return found


def _episodes(log: Log, protocols: Sequence[str]) -> list[tuple[Array, Array]]:
    """Times (T,) and readings (T, F, taxels) of the episodes that have them."""
    numbers = [e.episode for e in log.episodes if e.protocol in protocols]
    pairs = [(log.episode(k)["t_s"].to_numpy(dtype=float), log.touch(k)) for k in numbers]
    return [(time_s, touch) for time_s, touch in pairs if touch is not None]


def _finger(
    rest: Sequence[tuple[Array, Array]],
    press: Sequence[Array],
    grid: tuple[int, int] | None,
    threshold: float | None,
) -> TouchSensor:
    readings = np.concatenate([touch for _, touch in rest])
    offset = readings.mean(axis=0)
    drift, drift_std, noise = _drift(rest)
    level = NOISES * float(noise.max()) if threshold is None else threshold
    active = [binarise(touch, offset, level) for touch in press]
    dead, touched = _dead(active, grid)
    return TouchSensor(
        offset=tuple(offset),
        noise=tuple(noise),
        drift_s=tuple(drift),
        drift_std_s=tuple(drift_std),
        fastest_drift_s=float(drift[drift > SURE * drift_std].max(initial=0.0)),
        threshold=level,
        false_share=float(binarise(readings, offset, level).mean()),
        dead=dead,
        touched=touched,
    )


def _drift(rest: Sequence[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Slopes, their standard deviations and the noise about them, each (T,)."""
    pieces = [[_means(values) for values in episode] for episode in rest]
    time_s, means = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    squares = float(time_s @ time_s)
    slope = time_s @ means / squares
    free = max(len(time_s) - len(pieces) - 1, 1)
    left = ((means - np.outer(time_s, slope)) ** 2).sum(axis=0) / free
    level = [touch - touch.mean(axis=0) - np.outer(t - t.mean(), slope) for t, touch in rest]
    return slope, np.sqrt(left / squares), np.concatenate(level).std(axis=0)


def _means(values: Array) -> Array:
    """Means over the pieces of an episode, about their mean, shape (P, ...)."""
    means = np.stack([piece.mean(axis=0) for piece in np.array_split(values, PIECES)])
    return np.asarray(means - means.mean(axis=0))


def _dead(active: Sequence[Array], grid: tuple[int, int] | None) -> tuple[tuple[int, ...], int]:
    """Dead taxels, and the number of taxels that could be judged."""
    if not active or grid is None or active[0].shape[1] != grid[0] * grid[1]:
        return (), 0
    ever = np.any([a.any(axis=0) for a in active], axis=0)
    silent = np.zeros(active[0].shape[1], dtype=int)
    for contact in active:
        around = _around(contact.reshape(len(contact), *grid)).reshape(contact.shape)
        silent += ((around >= SURROUNDED) & ~contact).sum(axis=0)
    dead = ~ever & (silent >= WITNESSES)
    return tuple(int(k) for k in np.flatnonzero(dead)), int((ever | dead).sum())


def _around(contact: Array) -> Array:
    """Share of each taxel's neighbours, up to eight, that are in contact: shape (N, rows, cols)."""
    ring = np.ones((1, 3, 3))
    ring[0, 1, 1] = 0.0
    near, there = (
        correlate(v.astype(float), ring, mode="constant") for v in (contact, np.ones_like(contact))
    )
    return near / there
