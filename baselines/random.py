"""A baseline for sanity checks: it moves at random."""

from backends.state import Array
from baselines.baseline import Scripted


class Baseline(Scripted):
    """Uniform displacements in [-1, 1], drawn from its own seed."""

    def __call__(self, observation: Array) -> Array:
        """See `Scripted.__call__`."""
        return self.rng.uniform(-1, 1, (len(observation), self.action_width))
