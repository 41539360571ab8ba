"""The paper's observation: contact centres of the fingertips."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept


class Observation(observation.Observation):
    """Joint positions, u_d and contact centres."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        return (observation.center_channel(self.hand),)

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return (observation.centers(percept),)
