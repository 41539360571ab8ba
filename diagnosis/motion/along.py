"""The rigid-body model along a measured motion, and how it changes with masses and with gravity."""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.signal import savgol_filter

from backends.state import Array
from diagnosis.replay.chain import Chain, dynamics, workspace

STEP = 1e-5
"""Step of the numerical slopes of the bias torques [rad, rad/s]."""
SMOOTH_S, SMOOTH_SLOW_S, SLOW_S = 0.02, 0.1, 6e-3
"""Readings are smoothed over so long, and over more where samples are further apart than SLOW_S."""
AXES = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
"""Axes about which gravity may be tilted: the effect's first, then the other horizontal one."""

Model = tuple[Array, Array, Array, Array]
"""M (P, K, K) [kg m^2], h (P, K) [Nm], G = dh/dq and C = dh/dv (P, K, K) at P points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Along:
    """One episode's motion at P points of K joints, and the model there."""

    angle_rad: Array
    """q_m, shape (P, K)."""
    speed_rad_s: Array
    """v_m, shape (P, K)."""
    model: Model
    by_mass: tuple[Array, Array]
    """What M (K, P K K) and h (K, P K) gain when a joint's own link is twice as heavy, by joint."""
    by_tilt: tuple[Array, ...]
    """What h gains by sin(tilt) about each of `AXES`."""
    weight: Array
    """h by gravity alone (P, K) [Nm]."""

    def changed(self, mass: Array, tilt: Array) -> Model:
        """The model with links heavier by shares `mass` (K,) and gravity turned by `tilt` (2,)."""
        m, h, dq, dv = self.model
        if mass.any():
            more_m, more_h = (mass @ more for more in self.by_mass)
            m, h = m + more_m.reshape(m.shape), h + more_h.reshape(h.shape)
        for angle, more_h in zip(tilt, self.by_tilt, strict=True):
            if angle:
                h = h + np.sin(angle) * more_h + (np.cos(angle) - 1.0) * self.weight
        return m, h, dq, dv


def along(chain: Chain, angle_rad: Array, speed_rad_s: Array) -> Along:
    """The model of a chain at points of a motion, both (P, K)."""
    names = list(vars(chain))[: len(chain.numbers)]
    numbers = dict(zip(names, chain.numbers, strict=True))

    def sweep(step: float = 0.0, **other: Array) -> Model:
        points, joints = angle_rad.shape
        mass, dq, dv = np.zeros((3, points, joints, joints))
        bias, bodies = np.zeros((points, joints)), tuple((numbers | other).values())
        model = mass, bias, dq, dv
        _sweep(angle_rad, speed_rad_s, bodies, workspace(len(bodies[0]), joints), step, *model)
        return model

    base = sweep(STEP)
    by_mass = []
    for j in range(angle_rad.shape[1]):
        own = (chain.column == j) & ~chain.follows
        m, h, _, _ = sweep(mass_kg=np.where(own, 2.0, 1.0) * chain.mass_kg)
        by_mass.append(((m - base[0]).ravel(), (h - base[1]).ravel()))
    turned = (chain.gravity_m_s2 + np.cross(axis, chain.gravity_m_s2) for axis in AXES)
    by_tilt = tuple(sweep(gravity_m_s2=g)[1] - base[1] for g in turned)
    return Along(
        angle_rad=angle_rad,
        speed_rad_s=speed_rad_s,
        model=base,
        by_mass=(np.stack([m for m, _ in by_mass]), np.stack([h for _, h in by_mass])),
        by_tilt=by_tilt,
        weight=base[1] - sweep(gravity_m_s2=np.zeros(3))[1],
    )


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
    spare, moved = np.zeros((joints, joints)), np.zeros(joints)
    angle, speed = np.zeros(joints), np.zeros(joints)
    for i in range(points):
        dynamics(q[i], v[i], bodies, work, mass[i], bias[i])
        for k in range(joints if step > 0.0 else 0):
            for j in range(joints):
                angle[j] = q[i, j] + (step if j == k else 0.0)
                speed[j] = v[i, j] + (step if j == k else 0.0)
            dynamics(angle, v[i], bodies, work, spare, moved)
            for j in range(joints):
                dq[i, j, k] = (moved[j] - bias[i, j]) / step
            dynamics(q[i], speed, bodies, work, spare, moved)
            for j in range(joints):
                dv[i, j, k] = (moved[j] - bias[i, j]) / step
