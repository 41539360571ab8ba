"""A circle about the centre; each episode draws how fast it is entered: half a second to a lap.

On its way out the reference passes circles of all sizes, at the pace of the circle itself. A policy
trained on `circle` never sees a reference that stays near the centre.
"""

import math

from backends.state import Array
from tasks import circle
from tasks.circle import ENTRY_S

SLOWEST_S = 2.0
"""Time of one lap at the training pace [s]."""


class Task(circle.Task):
    """Laps on a circle of the given radius; the heading sets the time to enter it."""

    def entry_s(self, heading_rad: Array) -> Array:
        """See `circle.Task.entry_s`."""
        share = (heading_rad / (2 * math.pi)) % 1.0
        return ENTRY_S + (SLOWEST_S - ENTRY_S) * share
