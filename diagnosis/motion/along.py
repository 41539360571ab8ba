"""The rigid-body model along a measured motion, as given and in worlds with other loads."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.signal import savgol_filter

from backends.spec import Body, Spec, Vec3
from backends.state import Array
from diagnosis.motion.columns import with_load
from diagnosis.replay.dynamics import bias_torques, coefficients, dynamics, of_point, weights

STEP = 1e-5
"""Step of the numerical slopes of the bias torques [rad, rad/s]."""
PLACES = 4
"""So many places of loads are remembered beside the centre of mass and the end of each link."""
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

    def of(self, load: Array, gravity_m_s2: Array) -> Model:
        """The model with other loads (K, len(LINK)) and gravity (3,), which add to the nominal one.

        Its slopes are the nominal ones.
        """
        m, h, dq, dv = self.model
        fall = gravity_m_s2 - self.spec.gravity_m_s2
        h = h + self._weights @ fall if fall.any() else h.copy()
        rows = zip(self.spec.hand.driven, load, strict=True)
        every = ((b.joint.name, *one) for b, row in rows for one in _added(b, row).items())
        if added := [(joint, at_m, *masses) for joint, at_m, masses in every if masses.any()]:
            m = m.copy()
        for joint, at_m, kg, borne_kg in added:
            on, mass, turning, weight = self._point(joint, at_m)
            m[:, on, on] += kg * mass
            h[:, on] += kg * turning + borne_kg * (weight @ gravity_m_s2)
        return m, h, dq, dv, coefficients(m, h) if self.closed else OPEN

    @cached_property
    def _weights(self) -> Array:
        return weights(self.spec, self.angle_rad)

    @cached_property
    def _point(self) -> Callable[[str, Vec3], tuple[slice, Array, Array, Array]]:
        """The first joints, which move a place on a link, and what a kilogram there adds."""
        spec, moved = self.spec, (self.angle_rad, self.speed_rad_s)

        @lru_cache(PLACES + 2 * len(spec.hand.driven))
        def point(joint: str, at_m: Vec3) -> tuple[slice, Array, Array, Array]:
            mass, turning, weight = of_point(spec, joint, at_m, *moved)
            last = np.flatnonzero(mass.any(axis=(0, 1))).max(initial=-1)
            on = slice(0, int(last) + 1)
            return on, mass[:, on, on].copy(), turning[:, on].copy(), weight[:, on].copy()

        return point


def _added(body: Body, row: Array) -> dict[Vec3, Array]:
    """By place, what a link with another load (len(LINK),) gains [kg], (2,).

    Its mass, and that whose weight its drives bear.
    """
    found = dict[Vec3, Array]()
    for sign, one in ((-1.0, body), (1.0, with_load(body, row))):
        own, load = one.mass_kg, one.payload * one.mass_kg
        borne = own * (1.0 - one.carried)
        for at_m, masses in ((one.com_m, (own, borne)), (one.payload_m, (load, load))):
            found[at_m] = found.get(at_m, 0.0) + sign * np.array(masses)
    return found


def smoothed(position: Array, period_s: float) -> Array:
    """Readings (T, K) without what no joint does: a polynomial over a few samples."""
    span_s = SMOOTH_SLOW_S if period_s > SLOW_S else SMOOTH_S
    width = max(5, round(span_s / period_s) | 1)
    if len(position) <= width:
        return position
    return savgol_filter(position, width, 3 if width < 9 else 4, axis=0)
