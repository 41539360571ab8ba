"""Tactile calibration from readings without contact: offset, threshold, drift, dead taxels.

As in the paper, the offset of a taxel is the mean of its readings without contact. The reading
minus the offset is compared with one fixed threshold:

    s(t) = max(s_raw(t) - offset, 0),        in contact where s(t) > threshold
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, FiniteFloat
from scipy.ndimage import correlate

from backends.state import Array
from diagnosis.logs._meta import Part
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


Number = Annotated[FiniteFloat, AfterValidator(lambda value: float(f"{value:.5g}"))]
"""It keeps five digits."""
Size = Annotated[Number, Field(ge=0)]


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
    log: Log, grid: tuple[int, int], threshold: float | None = None
) -> dict[str, TouchSensor] | str:
    """The touch sensor of every finger, or why it is not identifiable from this log.

    `grid` holds the rows and columns of the taxels. `threshold` replaces the one computed from the
    noise.
    """
    quiet, pressed = (
        [
            (log.episode(one.episode)["t_s"].to_numpy(dtype=float), touch)
            for one in log.episodes
            if one.protocol in protocols and (touch := log.touch(one.episode)) is not None
        ]
        for protocols in (FREE_AIR, PROTOCOLS)
    )
    if sum(len(time_s) for time_s, _ in quiet) < LEAST_SAMPLES:
        return NO_READINGS
    found = {}
    for f, finger in enumerate(log.fingers):
        rest = [(time_s, touch[:, f]) for time_s, touch in quiet]
        readings = np.concatenate([touch for _, touch in rest])
        offset = readings.mean(axis=0)
        drift, drift_std, noise = _drift(rest)
        level = NOISES * float(noise.max()) if threshold is None else threshold
        dead, touched = _dead([binarise(touch[:, f], offset, level) for _, touch in pressed], grid)
        found[finger] = TouchSensor(
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
    return found


def _drift(rest: Sequence[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Slopes, their standard deviations and the noise about them, each (T,).

    Slopes are those of the means over pieces of an episode, about the episode's mean.
    """
    pieces = [
        [np.stack([piece.mean(axis=0) for piece in np.array_split(v, PIECES)]) for v in episode]
        for episode in rest
    ]
    time_s, means = (
        np.concatenate([part - part.mean(axis=0) for part in parts])
        for parts in zip(*pieces, strict=True)
    )
    squares = float(time_s @ time_s)
    slope = time_s @ means / squares
    free = max(len(time_s) - len(pieces) - 1, 1)
    left = ((means - np.outer(time_s, slope)) ** 2).sum(axis=0) / free
    level = [touch - touch.mean(axis=0) - np.outer(t - t.mean(), slope) for t, touch in rest]
    return slope, np.sqrt(left / squares), np.concatenate(level).std(axis=0)


def _dead(active: Sequence[Array], grid: tuple[int, int]) -> tuple[tuple[int, ...], int]:
    """Dead taxels, and the number of taxels that could be judged.

    Of a taxel's neighbours, up to eight, a share is in contact.
    """
    if not active or active[0].shape[1] != grid[0] * grid[1]:
        return (), 0
    contact = np.concatenate(active)
    ring = np.array([[[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]])
    near, there = (
        correlate(v.reshape(len(v), *grid).astype(float), ring, mode="constant")
        for v in (contact, np.ones_like(contact))
    )
    around = (near / there).reshape(contact.shape)
    silent = ((around >= SURROUNDED) & ~contact).sum(axis=0)
    ever = contact.any(axis=0)
    dead = ~ever & (silent >= WITNESSES)
    return tuple(np.flatnonzero(dead).tolist()), int((ever | dead).sum())
