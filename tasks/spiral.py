"""A spiral outwards from the centre that reaches its radius at the end of the episode."""

import numpy as np

from backends.state import Array
from tasks.task import EPISODE_S, Figure


class Task(Figure):
    """An Archimedean spiral with constant phase rate."""

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        radius = self.radius_m * time_s / EPISODE_S
        phase = self.rate_rad_s * time_s
        return radius[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
