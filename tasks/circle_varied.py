"""A circle about the centre; each episode draws its size and its pace.

From a third of the given radius and pace to the whole: paces evenly, sizes evenly by area, so that
large circles, which are harder, come more often.
"""

import math

import numpy as np

from backends.state import Array
from tasks.circle import ENTRY_S
from tasks.task import Figure

LINES = 7
"""Pairs of size and pace lie on so many lines, which cover all pairs evenly."""


class Task(Figure):
    """Laps on a circle of a drawn radius and pace; the heading decides both."""

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        share = heading_rad / (2 * math.pi) % 1.0
        size, pace = np.sqrt(1 + 8 * share) / 3, (1 + 2 * (LINES * share % 1.0)) / 3
        radius = self.radius_m * size * np.minimum(time_s / ENTRY_S, 1.0)
        phase = self.rate_rad_s * pace * time_s
        return radius[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
