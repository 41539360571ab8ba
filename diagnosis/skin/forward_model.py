"""The likelihood of skin readings: what taxels should answer, and what may be wrong with them.

The geometry says how deep every taxel is pressed. On top of it come the candidates' faults:

    reading = gain eased(depth) + slope t,   0 if dead
    active  = reading > 0.2 mm + threshold,  or a living neighbour within the halo of one that is

An answer as yes or no is a Bernoulli draw at a margin blurred by the geometry's own error; a depth
has that error. Both allow for a few wild answers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numba
import numpy as np
from scipy.special import ndtr

from backends.state import Array
from backends.touch import THRESHOLD_M, ease

EXACT_M, SHARP = 1e-5, 5e-3
"""Numerical error of depths: the blur of a taxel that nothing is near. That of an answer is a share
of its level: what drifts half as far as half of it answers at the same time."""
NEAR = 4.0
"""Blurs within which a press may be read or not."""
CLEARLY = 1.0
"""Blurs that a drift must be over what one is where the taxel is silent."""
WILD, ANYWHERE_M = 1e-3, 1e-3
"""Share of answers that nothing explains, and how far off a wild depth may be."""
MISSED = 0.01
"""Share of wrong answers that is no gap, beside those that the blur predicts."""
NEVER = 1e-9
"""A chance under this is none."""
ALIKE = 2.5
"""Samples that tell as much as one: a grasp moves slowly."""


@dataclass(frozen=True, kw_only=True)
class Pressed:
    """S samples of F tips with K taxels, thinned in time."""

    time_s: Array
    """Since the start of the episode, shape (S,)."""
    depth_m: Array
    """How deep the geometry presses every taxel, negative where it is away, shape (S, F, K)."""
    reading: Array
    """Depths [m], or 1 and 0, shape (S, F, K)."""
    touched: Array
    """Whether the finger is touched at all, shape (S, F), bool."""
    binary: bool
    history: tuple[tuple[Array, Array], ...] = ()
    """By episode the depths of all its samples, none where a finger is not touched, (T, F, K) [m],
    and which of them these are; where readings are depths."""

    @cached_property
    def touching_m(self) -> Array:
        """The depths of fingers that are touched, none of the others, shape (S, F, K)."""
        return np.where(self.touched[..., None], self.depth_m, -np.inf)

    @cached_property
    def _eased(self) -> dict[float, Array]:
        return {0.0: np.maximum(self.touching_m, 0.0)}

    def eased_m(self, hysteresis: float) -> Array:
        """The depths that are read where an easing press reads up to a share more, (S, F, K)."""
        if hysteresis not in self._eased:
            parts = (_eased(depth, hysteresis)[rows] for depth, rows in self.history)
            self._eased[hysteresis] = np.concatenate(list(parts))
        return self._eased[hysteresis]


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What is wrong with a skin, and how blurred the geometry is."""

    threshold_m: float = 0.0
    """Beyond 0.2 mm."""
    halo_m: float = 0.0
    slope_m_s: Array = field(default_factory=lambda: np.zeros(()))
    """Drift of every taxel, shape (F, K) or ()."""
    fastest_m_s: float = 0.0
    """Slopes are spread evenly up to this."""
    gain: Array = field(default_factory=lambda: np.ones(()))
    """Of every taxel, shape (F, K) or (), where readings are depths."""
    hysteresis: float = 0.0
    """Share by which an easing press may read more, where readings are depths."""
    dead: Array = field(default_factory=lambda: np.zeros((), dtype=bool))
    """Taxels that never answer, shape (F, K) or ()."""
    dead_share: float = 0.0
    """Of all taxels; what never answered may be one of them, or not."""
    blur_m: float
    """Standard deviation of the depth: the geometry's own error."""

    @property
    def level_m(self) -> float:
        """Reading that a taxel answers from."""
        return THRESHOLD_M + self.threshold_m

    def blurs_m(self, data: Pressed) -> Array:
        """The same of every depth, shape (S, F, K): it matters where something is near."""
        return np.where(data.depth_m > -NEAR * self.blur_m, self.blur_m, EXACT_M)


def expected(data: Pressed, faults: Faults, near: Array | None = None) -> Array:
    """Readings [m], or probabilities of an answer, shape (S, F, K).

    `near` tells which taxels of a tip are within the halo of each other, bool (F, K, K).
    """
    alive = ~np.broadcast_to(faults.dead, data.depth_m.shape[1:])
    drifted_m = data.time_s[:, None, None] * faults.slope_m_s
    if not data.binary:
        return (faults.gain * data.eased_m(faults.hysteresis) + drifted_m) * alive
    # what is short of answering by so much does, by its press or by its drift
    short_m = faults.level_m - drifted_m
    pressed = (data.touching_m - short_m) / faults.blur_m
    chance = ndtr(np.maximum(pressed, -short_m / (SHARP * faults.level_m)))
    if near is not None:
        chance = _spread(chance, near)
    return WILD + (1 - 2 * WILD) * chance * alive


@numba.njit(cache=True)
def _eased(depth, stays):
    """Depths (T, F, K) as they are read one after the other, see `backends.touch.ease`."""
    out, held = depth.copy(), np.zeros(depth.shape[1:])
    for s in range(len(out)):
        for f in range(out.shape[1]):
            ease(stays, out[s, f], held[f])
    return out


@numba.njit(cache=True)
def _spread(chance, near):
    """The largest chance (S, F, K) among the neighbours of every taxel."""
    out = chance.copy()
    samples, tips, taxels = chance.shape
    for s in range(samples):
        for f in range(tips):
            for j in range(taxels):
                if chance[s, f, j] > NEVER:
                    for k in range(taxels):
                        if near[f, j, k]:
                            out[s, f, k] = max(out[s, f, k], chance[s, f, j])
    return out


def alone(data: Pressed, faults: Faults, near: Array) -> Pressed:
    """Samples without a halo: who answers is who takes along nobody that does not, or is dead.

    The erosion of what answers by the halo, whose dilation is the most that a halo explains
    (Serra, Image Analysis and Mathematical Morphology, 1982). Who would have to drift faster than
    where it is silent, in any episode, was taken along.
    """
    silent = (data.reading < 0.5) & ~np.broadcast_to(faults.dead, data.reading.shape[1:])
    silent = _spread(silent.astype(float), near) > 0.5
    time_s = np.maximum(data.time_s[:, None, None], np.finfo(float).tiny)
    depth_m, surely_m = data.touching_m, data.touching_m - CLEARLY * faults.blur_m
    least_m_s = (faults.level_m - np.maximum(depth_m, 0.0)) / time_s
    most_m_s = (faults.level_m - np.maximum(surely_m, 0.0)) / time_s
    taken = least_m_s >= np.where(silent, most_m_s, np.inf).min(axis=0)
    return replace(data, reading=(~silent & ~taken).astype(float))


def nats(data: Pressed, faults: Faults, near: Array | None = None) -> Array:
    """Log-likelihood of every answer over `ALIKE`, shape (S, F, K)."""
    shown = expected(data, faults, near)
    if data.binary:
        return np.log(np.where(data.reading > 0.5, shown, 1 - shown)) / ALIKE
    blur_m = faults.blurs_m(data)
    density = np.exp(-0.5 * ((data.reading - shown) / blur_m) ** 2) / (np.sqrt(2 * np.pi) * blur_m)
    answer = (1 - WILD) * density + WILD / ANYWHERE_M
    silence = (1 - WILD) * ndtr(-shown / blur_m) + WILD
    return np.log(np.where(data.reading > 0, answer, silence)) / ALIKE


def gap(
    data: Pressed, faults: Faults, near: Array | None = None, finger: int | None = None
) -> float:
    """Root mean square of what answers otherwise than expected, over what is allowed.

    On all fingers, or on the one given. Of yes and no, wrong answers are counted among what is
    active or should be; of depths, errors where anything is pressed.
    """
    shown = expected(data, faults, near)
    some = (shown > (WILD if data.binary else 0.0)) | (data.reading > 0)
    if finger is not None:
        some = some & (np.arange(some.shape[1]) == finger)[:, None]
    if not some.any():
        return 0.0
    if data.binary:
        wrong = np.where(data.reading > 0.5, shown < 0.5, shown >= 0.5)[some].mean()
        return float(np.sqrt(wrong / (MISSED + np.minimum(shown, 1 - shown)[some].mean())))
    return float(np.sqrt(np.mean(((data.reading - shown) / faults.blurs_m(data))[some] ** 2)))


def joined(parts: Sequence[Pressed]) -> Pressed:
    """Samples of several episodes."""
    names = ("time_s", "depth_m", "reading", "touched")
    whole: dict[str, Any] = {k: np.concatenate([getattr(p, k) for p in parts]) for k in names}
    history = tuple(one for part in parts for one in part.history)
    return replace(parts[0], history=history, **whole)
