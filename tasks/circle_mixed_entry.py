"""A circle about the centre, entered within half a second to a lap: each episode draws how fast.

The reference passes all sizes on its way out, at the pace of the circle itself. A policy trained on
`circle` knows no reference near the centre but one that leaves it at once.
"""

import math

from backends.state import Array
from tasks import circle
from tasks.circle import ENTRY_S

SLOWEST_S = 2.0
"""One lap at the training pace."""


class Task(circle.Task):
    """Laps on a circle of the given radius; the heading decides how long it is entered."""

    def entry_s(self, heading_rad: Array) -> Array:
        """See `circle.Task.entry_s`."""
        share = (heading_rad / (2 * math.pi)) % 1.0
        return ENTRY_S + (SLOWEST_S - ENTRY_S) * share
