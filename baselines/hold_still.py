"""A baseline for sanity checks: it never moves its targets."""

import numpy as np

from backends.state import Array
from baselines.baseline import Scripted


class Baseline(Scripted):
    """Zero displacement, always."""

    def __call__(self, observation: Array) -> Array:
        """See `Scripted.__call__`."""
        return np.zeros((len(observation), self.action_width))
