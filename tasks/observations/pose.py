"""The ablation without touch: the stick's pose."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept


class Observation(observation.Observation):
    """Joint positions, u_d and the stick's pose."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        return observation.POSE_CHANNELS

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return observation.pose(self.hand, percept)
