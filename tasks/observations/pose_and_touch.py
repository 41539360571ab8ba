"""The ablation with one bit per finger: the stick's pose and whether each tip is in contact."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept


class Observation(observation.Observation):
    """Joint positions, u_d, the stick's pose and binary contact."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        width = len(self.hand.fingertips)
        binary = Channel(name="in_contact", unit="1", width=width, scale=1.0)
        return (*observation.POSE_CHANNELS, binary)

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return (*observation.pose(self.hand, percept), percept.touch.in_contact)
