"""The path of a target from the policy to the drive: steps, jitter, losses, delay and rate limit.

They act in this order: a policy period's target is rounded to a step; it is sent late by a random
time, and never where the next one is due before; it may be lost, then the last one is kept; the bus
delays the target; the drive limits its rate, and counts the angle from its own zero. Without any of
these the target passes unchanged.
"""

from collections.abc import Sequence
from dataclasses import astuple

import numba
import numpy as np

from backends.noise import uniform
from backends.spec import Spec
from backends.state import Array


@numba.njit(cache=True)
def delayed(ring, tick, delay_ticks):
    """The value `delay_ticks` before `tick` in a ring buffer; linear between ticks."""
    whole = int(delay_ticks)
    late, size = delay_ticks - whole, ring.shape[0]
    now = ring[(tick - whole) % size]
    return now if late == 0.0 else (1.0 - late) * now + late * ring[(tick - whole - 1) % size]


@numba.njit(cache=True)
def follow(target, tick, substeps, seed, p, dt, kept, ring, out):
    """Write the targets that reach the drives at `tick` (N,) into `out`.

    `kept` and `ring` are the memory of the path.
    """
    for n in range(target.shape[0]):
        for j in range(target.shape[1]):
            delay, slowness, loss, step, jitter = p[n, j]
            fresh, packet, late = tick[n] == 0, tick[n] // substeps, 0
            if jitter > 0.0 and not fresh:
                late = int(jitter / dt * uniform(seed[n], packet, 1))
            if tick[n] % substeps == late and (
                fresh or loss == 0.0 or uniform(seed[n], packet, 0) >= loss
            ):
                kept[n, j] = target[n, j]
                if step > 0.0:
                    kept[n, j] = step * np.round(target[n, j] / step)
            if fresh:
                ring[n, j, :] = kept[n, j]
            ring[n, j, tick[n] % ring.shape[2]] = kept[n, j]
            wanted = delayed(ring[n, j], tick[n], delay / dt)
            if slowness > 0.0 and not fresh:
                most = dt / slowness
                wanted = out[n, j] + min(max(wanted - out[n, j], -most), most)
            out[n, j] = wanted


def rounded(target_rad: Array, step_rad: Array) -> Array:
    """Targets (..., J) as the nearest multiples of steps (J,); as they are where a step is 0."""
    if not np.any(step_rad):
        return target_rad
    some = np.where(step_rad > 0.0, step_rad, 1.0)
    return np.where(step_rad > 0.0, some * np.round(target_rad / some), target_rad)


class CommandBank:
    """The command paths of N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        timing = specs[0].timing
        self._dt_s, self._substeps = timing.drive_s, timing.substeps
        paths = [[astuple(b.joint.command) for b in s.hand.driven] for s in specs]
        self._parameters = np.array(paths)
        self._zero_rad = np.array([[drive.zero_rad for drive in s.drives] for s in specs])
        self.acts = bool(self._parameters.any() or self._zero_rad.any())
        """Whether this path changes any target."""
        shape = self._parameters.shape[:2]
        ticks = ring_ticks(self._parameters[..., 0], self._dt_s)
        self._kept, self._out = np.zeros((2, *shape))
        self._ring = np.zeros((*shape, ticks))

    def step(self, target_rad: Array, tick: Array, seed: Array) -> Array:
        """The targets (N, J) [rad] that reach the drives at period `tick` (N,) of an episode."""
        if not self.acts:
            return target_rad
        follow(
            target_rad,
            tick,
            self._substeps,
            seed,
            self._parameters,
            self._dt_s,
            self._kept,
            self._ring,
            self._out,
        )
        return self._out - self._zero_rad


def ring_ticks(delay_s: Array, dt_s: float) -> int:
    """Length of a ring buffer that holds the longest of the delays."""
    return int(delay_s.max() / dt_s) + 2
