"""A circle about the centre; the reference moves from the centre to the circle in half a second."""

import numpy as np

from backends.state import Array
from tasks.task import Figure

ENTRY_S = 0.5


class Task(Figure):
    """Laps on a circle of the given radius."""

    repeats = True

    def entry_s(self, heading_rad: Array) -> Array:
        """Time that each episode takes from the centre to the circle [s], shape (N,)."""
        return np.full(len(heading_rad), ENTRY_S)

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        radius = self.radius_m * np.minimum(time_s / self.entry_s(heading_rad), 1.0)
        phase = self.rate_rad_s * time_s
        return radius[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
