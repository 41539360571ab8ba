"""The rigid-body model along a measured motion, and how it changes with masses and with gravity."""

from dataclasses import dataclass, replace
from functools import cached_property

import numba
import numpy as np
from scipy.signal import savgol_filter

from backends.spec import Vec3
from backends.state import Array
from diagnosis.replay.chain import Chain, dynamics, workspace

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


Model = tuple[Array, Array, Array, Array]
"""M (P, K, K) [kg m^2], h (P, K) [Nm], G = dh/dq and C = dh/dv (P, K, K) at P points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Along:
    """One episode's motion at P points of K joints, and the model of a chain there."""

    chain: Chain
    angle_rad: Array
    """q_m, shape (P, K)."""
    speed_rad_s: Array
    """v_m, shape (P, K)."""
    loaded: tuple[Chain, ...] = ()
    """L chains: each joint's own link twice as heavy, as much at the end of each last one, and each
    link with its whole weight carried beside the drives, on top of what is."""

    @cached_property
    def model(self) -> Model:
        """The model as the chain has it."""
        return self._swept(STEP)

    @property
    def without_slopes(self) -> tuple[Array, Array]:
        """M and h of the model, in less time."""
        return self._swept()[:2]

    @cached_property
    def by_load(self) -> tuple[Array, Array]:
        """What M (L, P K K) and h (L, P K) gain with each of the chains `loaded`."""
        found = [replace(self, chain=one).without_slopes for one in self.loaded]
        return tuple(  # type: ignore[return-value]
            np.stack([(model[i] - self.model[i]).ravel() for model in found]) for i in (0, 1)
        )

    @cached_property
    def by_gravity(self) -> Array:
        """What h gains with gravity along x, y and z, shape (3, P, K) [Nm per m/s^2]."""
        none = self._swept(gravity_m_s2=np.zeros(3))[1]
        return np.stack([self._swept(gravity_m_s2=axis)[1] - none for axis in np.eye(3)])

    def changed(self, load: Array, tilt: Array) -> Model:
        """The model with shares `load` (L,) of what `loaded` adds, gravity turned by `tilt`."""
        m, h, dq, dv = self.model
        if load.any():
            more_m, more_h = (load @ more for more in self.by_load)
            m, h = m + more_m.reshape(m.shape), h + more_h.reshape(h.shape)
        if tilt.any():
            gravity = self.chain.gravity_m_s2
            h = h + np.tensordot(turned(gravity, tilt) - gravity, self.by_gravity, 1)
        return m, h, dq, dv

    def _swept(self, step: float = 0.0, **other: Array) -> Model:
        """The model with other numbers of the chain; slopes are zero without a step."""
        bodies = replace(self.chain, **other).numbers
        points, joints = self.angle_rad.shape
        mass, dq, dv = np.zeros((3, points, joints, joints))
        model = mass, np.zeros((points, joints)), dq, dv
        work = workspace(len(bodies[0]), joints)
        _sweep(self.angle_rad, self.speed_rad_s, bodies, work, step, *model)
        return model


def smoothed(position: Array, period_s: float) -> Array:
    """Readings (T, K) without what no joint does: a polynomial over a few samples."""
    span_s = SMOOTH_SLOW_S if period_s > SLOW_S else SMOOTH_S
    width = max(5, round(span_s / period_s) | 1)
    if len(position) <= width:
        return position
    return savgol_filter(position, width, 3 if width < 9 else 4, axis=0)


@numba.njit(cache=True)
def _sweep(q, v, bodies, work, step, mass, bias, dq, dv):
    points, joints = q.shape
    none, moved = np.zeros((0, 0)), np.zeros(joints)
    angle, speed = np.zeros(joints), np.zeros(joints)
    for i in range(points):
        dynamics(q[i], v[i], bodies, work, mass[i], bias[i])
        for k in range(joints if step > 0.0 else 0):
            for j in range(joints):
                angle[j] = q[i, j] + (step if j == k else 0.0)
                speed[j] = v[i, j] + (step if j == k else 0.0)
            dynamics(angle, v[i], bodies, work, none, moved)
            for j in range(joints):
                dq[i, j, k] = (moved[j] - bias[i, j]) / step
            dynamics(q[i], speed, bodies, work, none, moved)
            for j in range(joints):
                dv[i, j, k] = (moved[j] - bias[i, j]) / step
