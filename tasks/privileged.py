"""What a critic may see in training: the simulator's state, behind a policy's observation."""

import numpy as np

from backends.state import Array
from tasks.observation import POSE_CHANNELS, Channel, Observation, Percept, pose

AHEAD_STEPS = (3, 8, 20, 50)
"""How many steps ahead the critic sees u_d: 0.06 to 1 s."""


class Privileged(Observation):
    """A policy's observation and, behind it, the simulator's state.

    Only training needs a critic, so it may know what no sensor of the hand tells (asymmetric
    actor-critic, Pinto et al. 2017).
    """

    def __init__(self, policy: Observation) -> None:
        super().__init__(policy.hand, policy.law)
        self._policy = policy
        joints, tips = len(self.hand.driven), len(self.hand.fingertips)
        state = (
            ("stick_velocity", "m/s", 3, 0.1),
            ("stick_angular_velocity", "rad/s", 3, 1.0),
            ("joint_speed", "rad/s", joints, 1.0),
            ("motor_lead", "rad", joints, 0.01),
            ("target_lead", "rad", joints, 0.1),
            ("contact_force", "N", 3 * tips, 1.0),
            ("coming_axes", "1", 3 * len(AHEAD_STEPS), 1.0),
        )
        self._state = [Channel(name=n, unit=u, width=w, scale=s) for n, u, w, s in state]

    def extra_channels(self) -> tuple[Channel, ...]:
        """See `Observation.extra_channels`."""
        return (*self._policy.extra_channels(), *POSE_CHANNELS, *self._state)

    def extra(self, percept: Percept) -> tuple[Array, ...]:
        """See `Observation.extra`."""
        state, last = percept.state, percept.axes.shape[1] - 1
        steps = np.minimum(percept.steps[:, None] + AHEAD_STEPS, last)
        values = (
            state.stick_vel_m_s,
            state.stick_omega_rad_s,
            state.joint_rad_s,
            state.motor_rad - state.joint_rad,
            percept.target_rad - state.measured_rad,
            state.contact_force_n,
            np.take_along_axis(percept.axes, steps[:, :, None], axis=1),
        )
        scaled = (v.reshape(len(v), -1) / c.scale for v, c in zip(values, self._state, strict=True))
        return (*self._policy.extra(percept), *pose(self.hand, percept), *scaled)
