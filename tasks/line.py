"""A straight line through the centre in a random direction, back and forth."""

import numpy as np

from backends.state import Array
from tasks.task import Figure


class Task(Figure):
    """Harmonic motion along the episode's heading, by `radius_m` to either side of the centre."""

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        along = self.radius_m * np.sin(self.rate_rad_s * time_s)
        return along[:, None] * np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=1)
