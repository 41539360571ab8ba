"""The rigid-body model along a measured motion, as given and in worlds with other loads."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backends.spec import Spec, Vec3
from backends.state import Array
from diagnosis.motion.smooth import smooth
from diagnosis.replay.dynamics import bias_torques, coefficients, dynamics

STEP = 1e-5
"""Step of the numerical slopes of the bias torques [rad, rad/s]."""
SMOOTH_S, SMOOTH_SLOW_S, SLOW_S = 0.02, 0.1, 6e-3
"""Readings are smoothed over so long, and over more where samples are further apart than SLOW_S."""
AXES = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
"""Axes about which gravity may be tilted: the effect's first, then the other horizontal one."""


def turned(gravity_m_s2: Vec3 | Array, tilt: Array) -> Array:
    """Gravity (3,) turned by angles about `AXES` (2,) [rad]."""
    gravity = np.array(gravity_m_s2)
    for angle, axis in zip(tilt, AXES, strict=True):
        gravity = np.cos(angle) * gravity + np.sin(angle) * np.cross(axis, gravity)
    return gravity


Model = tuple[Array, Array, Array, Array, Array]
"""M (P, K, K) [kg m^2], h (P, K) [Nm], G = dh/dq and C = dh/dv (P, K, K) at P points; and
coefficients (5, 3, 5) where the model has a `closed_form`, which is then taken instead."""
OPEN = np.zeros((0, 3, 5))
"""Coefficients of no closed form."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Along:
    """One episode's motion at P points of K joints, and the model of a limb there."""

    spec: Spec
    angle_rad: Array
    """q_m, shape (P, K)."""
    speed_rad_s: Array
    """v_m, shape (P, K)."""
    closed: bool = False
    """Whether the points are the poses that a closed form is of."""

    @cached_property
    def model(self) -> tuple[Array, Array, Array, Array]:
        """The model as the limb has it, without coefficients."""
        q, v = self.angle_rad, self.speed_rad_s
        mass, bias = dynamics(self.spec, q, v)
        dq, dv = np.empty_like(mass), np.empty_like(mass)
        for j, move in enumerate(STEP * np.eye(q.shape[1])):
            dq[:, :, j] = (bias_torques(self.spec, q + move, v) - bias) / STEP
            dv[:, :, j] = (bias_torques(self.spec, q, v + move) - bias) / STEP
        return mass, bias, dq, dv

    def of(self, spec: Spec) -> Model:
        """The model of a world with other loads and gravity; its slopes are the nominal ones."""
        m, h, dq, dv = self.model
        if spec != self.spec:
            m, h = dynamics(spec, self.angle_rad, self.speed_rad_s)
        return m, h, dq, dv, coefficients(m, h) if self.closed else OPEN


def smoothed(position: Array, period_s: float) -> Array:
    """Readings (T, K) without what no joint does: a polynomial over a few samples."""
    span_s = SMOOTH_SLOW_S if period_s > SLOW_S else SMOOTH_S
    width = max(5, round(span_s / period_s) | 1)
    if len(position) <= width:
        return position
    return smooth(position, width, 3 if width < 9 else 4)
