"""The ablation with both: the stick's pose and contact centres."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept


class Observation(observation.Observation):
    """Joint positions, u_d, the stick's pose and contact centres."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        return (*observation.POSE_CHANNELS, observation.center_channel(self.hand))

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return (*observation.pose(self.hand, percept), observation.centers(percept))
