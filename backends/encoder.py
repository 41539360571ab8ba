"""Position sensors: how policies and logs read the angles of joints or motors.

    reading = quantise((1 + scale_error) a + once cos(a) + across sin(a) + bias + noise)
    a = angle(t - delay) + zero

Without these errors the reading is the angle.
"""

from collections.abc import Sequence
from dataclasses import astuple

import numba
import numpy as np

from backends.command import delayed, ring_ticks
from backends.noise import normal
from backends.spec import Spec
from backends.state import Array

REPEATED = 30
"""Repetitions to the last digit of an angle."""


@numba.njit(cache=True)
def note(angle, tick, ring):
    """Store the angles (N, J) of `tick` (N,)."""
    for n in range(angle.shape[0]):
        for j in range(angle.shape[1]):
            if tick[n] == 0:
                ring[n, j, :] = angle[n, j]
            ring[n, j, tick[n] % ring.shape[2]] = angle[n, j]


@numba.njit(cache=True)
def read(tick, seed, p, dt, ring, out):
    """Write the readings (N, J) for the tick that was stored last."""
    for n in range(out.shape[0]):
        for j in range(out.shape[1]):
            bias, scale, resolution, noise, delay, cosine, sine, zero = p[n, j]
            angle = delayed(ring[n, j], tick[n], delay / dt) + zero
            reading = (1.0 + scale) * angle + bias
            if cosine != 0.0 or sine != 0.0:
                reading += cosine * np.cos(angle) + sine * np.sin(angle)
            if noise > 0.0:
                reading += noise * normal(seed[n], tick[n], 1 + j)
            if resolution > 0.0:
                reading = resolution * np.round(reading / resolution)
            out[n, j] = reading


def angles(
    reading: Array, bias: Array, scale: Array, cosine: Array, sine: Array, zero: Array | float = 0.0
) -> Array:
    """Angles [rad] at rest at which sensors with these errors show readings, all (..., J).

    What goes once per turn is found by repetition, each of which divides the error by 4 or more.
    """
    found = np.asarray((reading - bias) / (1.0 + scale))
    for _ in range(REPEATED if np.any(cosine) or np.any(sine) else 0):
        once = cosine * np.cos(found) + sine * np.sin(found)
        found = np.asarray((reading - bias - once) / (1.0 + scale))
    return found - zero


class EncoderBank:
    """The position sensors of N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        self._dt_s = specs[0].timing.drive_s
        joints = [[b.joint for b in s.hand.driven] for s in specs]
        zeros = [[drive.zero_rad for drive in s.drives] for s in specs]
        own = [[astuple(j.encoder) for j in row] for row in joints]
        self._parameters = np.concatenate([own, np.expand_dims(zeros, 2)], axis=2)
        self._at_motor = np.array([[j.sensor == "motor" for j in row] for row in joints])
        self._acts = bool(self._parameters.any())
        self._plain = not self._acts and not self._at_motor.any()
        self.remembers = bool(self._parameters[..., 4].any())
        """Whether a sensor is late, so that the angles of every drive period have to be stored."""
        ticks = ring_ticks(self._parameters[..., 4], self._dt_s)
        self._ring = np.zeros((*self._at_motor.shape, ticks))

    def note(self, joint_rad: Array, motor_rad: Array, tick: Array) -> None:
        """Store the angles (N, J) [rad] at drive period `tick` (N,) of an episode."""
        if self._acts:
            note(np.where(self._at_motor, motor_rad, joint_rad), tick, self._ring)

    def read(self, joint_rad: Array, motor_rad: Array, tick: Array, seed: Array) -> Array:
        """Readings [rad], shape (N, J), at the period that was stored last."""
        if self._plain:
            return joint_rad
        reading = np.where(self._at_motor, motor_rad, joint_rad)
        if self._acts:
            read(tick, seed, self._parameters, self._dt_s, self._ring, reading)
        return reading
