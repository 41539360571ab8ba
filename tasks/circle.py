"""A circle about the centre, entered from the centre within half a second."""

import numpy as np

from backends.state import Array
from tasks.task import Figure

ENTRY_S = 0.5


class Task(Figure):
    """Laps on a circle of the given radius."""

    repeats = True

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        radius = self.radius_m * np.minimum(time_s / ENTRY_S, 1.0)
        phase = self.rate_rad_s * time_s
        return radius[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1)
