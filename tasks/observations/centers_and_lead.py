"""Not in the paper: contact centres and the lead of each drive's target over its joint."""

from backends.state import Array
from tasks import observation
from tasks.observation import Channel, Percept

LEAD_SCALE_RAD = 0.1
"""Scale by which the target's lead is divided [rad]."""


class Observation(observation.Observation):
    """Joint positions, u_d, contact centres and target minus measured position."""

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        width = len(self.hand.driven)
        lead = Channel(name="target_lead", unit="rad", width=width, scale=LEAD_SCALE_RAD)
        return (observation.center_channel(self.hand), lead)

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        lead_rad = percept.target_rad - percept.state.measured_rad
        return observation.centers(percept), lead_rad / LEAD_SCALE_RAD
