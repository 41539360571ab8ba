"""The hand is mounted at an angle, so gravity points in another direction than expected."""

import dataclasses
import math

from backends import effect
from backends.spec import Spec


class Effect(effect.Effect):
    """Rotation of gravity about the world's y axis; positive angles tilt it towards +x.

    Law: Gravity turns about the world's y axis, towards +x where positive; its size stays.
    Source: A rotation.
    Hardware: No published range found; a hand on a wrist sees all of it.
    Log: A constant torque on every joint, so a constant offset load / kp; the stick hangs askew.
    Confused with: encoder-bias (which is no torque), link-mass. Two mountings of the hand tell.
    """

    group = "links and gravity"
    dimension, unit = "angle", "deg"
    bounds = (-math.pi / 2, math.pi / 2)
    levels, opposite = (0.03, 0.1, 0.3), (-0.03, -0.1, -0.3)
    per_joint = False
    least = 0.015
    most = 0.7
    either_sign = True

    @classmethod
    def spec_fields(cls) -> tuple[str, ...]:
        """See `Effect.spec_fields`."""
        return ("spec.gravity_m_s2",)

    def on_spec(self, spec: Spec) -> Spec:
        """See `Effect.on_spec`."""
        x, y, z = spec.gravity_m_s2
        c, s = math.cos(self.magnitude), math.sin(self.magnitude)
        return dataclasses.replace(spec, gravity_m_s2=(c * x - s * z, y, s * x + c * z))
