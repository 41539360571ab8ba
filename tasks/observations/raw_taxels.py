"""The ablation without processing: every taxel by itself."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept


class Observation(observation.Observation):
    """Joint positions, u_d and all binary taxels."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        taxels = self.hand.taxels
        width = len(self.hand.fingertips) * taxels.rows * taxels.columns
        return (Channel(name="taxel", unit="1", width=width, scale=1.0),)

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        return (percept.touch.active.reshape(len(percept.touch.active), -1),)
