"""A figure of eight that crosses itself at the centre."""

import numpy as np

from backends.state import Array
from tasks.task import Figure


class Task(Figure):
    """The lemniscate of Gerono: x = r sin(p) cos(p), y = r sin(p)."""

    def offset_m(self, time_s: Array, heading_rad: Array) -> Array:
        """See `Figure.offset_m`."""
        phase = self.rate_rad_s * time_s
        x = np.sin(phase) * np.cos(phase)
        return self.radius_m * np.stack([x, np.sin(phase)], axis=1)
