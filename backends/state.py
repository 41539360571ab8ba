"""The state that every engine reports, and its one convention of frames and order.

World frame, z up, right-handed. N worlds, J driven joints and F fingertips, in spec order.
Quaternions are w, x, y, z; they rotate stick coordinates into world coordinates.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numba
import numpy as np
from numba import literal_unroll

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """Initial state of the episodes of N worlds; everything is at rest."""

    joint_rad: Array
    """Driven joint angles [rad], shape (N, J)."""
    stick_pos_m: Array
    """Stick centre [m], shape (N, 3)."""
    stick_quat_wxyz: Array
    """Stick orientation, shape (N, 4)."""
    noise_seed: Array = field(default_factory=lambda: np.zeros(0))
    """Seeds of each episode's noise, whole numbers below 2^53, shape (N,); default: zeros."""

    def __post_init__(self) -> None:
        if self.noise_seed.size == 0:
            object.__setattr__(self, "noise_seed", np.zeros(len(self.joint_rad)))


@dataclass(frozen=True, kw_only=True)
class State:
    """The observable state of N worlds; an engine overwrites these arrays at every step."""

    joint_rad: Array
    """Joint angles, link side [rad], shape (N, J)."""
    joint_rad_s: Array
    """Joint speeds, link side [rad/s], shape (N, J)."""
    motor_rad: Array
    """Motor angles reflected through the gear [rad], shape (N, J)."""
    measured_rad: Array
    """Readings of the position sensors [rad], shape (N, J)."""
    drive_torque_nm: Array
    """PD torque of the motors [Nm], shape (N, J)."""
    stick_pos_m: Array
    """Stick centre [m], shape (N, 3)."""
    stick_quat_wxyz: Array
    """Stick orientation, shape (N, 4)."""
    stick_vel_m_s: Array
    """Velocity of the stick's centre [m/s], shape (N, 3)."""
    stick_omega_rad_s: Array
    """Angular velocity of the stick, world frame [rad/s], shape (N, 3)."""
    contact_point_m: Array
    """Force-weighted mean contact point per fingertip [m], shape (N, F, 3); 0 without contact."""
    contact_force_n: Array
    """Normal force of the stick on each fingertip, world frame [N], shape (N, F, 3)."""

    @classmethod
    def allocate(
        cls,
        worlds: int,
        joints: int,
        tips: int,
        make: Callable[[tuple[int, ...]], Array] = np.zeros,
    ) -> "State":
        """A state of zeros; `make` allocates an array of a shape, for example in shared memory."""
        per_joint, per_tip = (worlds, joints), (worlds, tips, 3)
        shapes = {
            "stick_pos_m": (worlds, 3),
            "stick_quat_wxyz": (worlds, 4),
            "stick_vel_m_s": (worlds, 3),
            "stick_omega_rad_s": (worlds, 3),
            "contact_point_m": per_tip,
            "contact_force_n": per_tip,
        }
        return cls(**{f.name: make(shapes.get(f.name, per_joint)) for f in fields(cls)})

    def rows(self, part: slice) -> "State":
        """A view of some worlds."""
        return State(**{f.name: getattr(self, f.name)[part] for f in fields(self)})

    def first_bad_signal(self) -> str | None:
        """Name of the first signal that is NaN or infinite, else None."""
        signals = vars(self)
        if _are_finite(*signals.values()):
            return None
        return next(name for name, signal in signals.items() if not is_finite(signal))


@numba.njit(cache=True)
def _are_finite(*signals):
    bad = False
    for values in literal_unroll(signals):
        for value in values.ravel():
            bad |= not np.isfinite(value)
    return not bad


def is_finite(values: Array) -> bool:
    """Whether no value is NaN or infinite; quick for small arrays."""
    return _are_finite(values)


def quat_z_axis(quat_wxyz: Array) -> Array:
    """World direction of the stick's long axis, shape (..., 3), from quaternions (..., 4)."""
    axis = np.empty((*quat_wxyz.shape[:-1], 3))
    _z_axes(quat_wxyz.reshape(-1, 4), axis.reshape(-1, 3))
    return axis


@numba.njit(cache=True)
def _z_axes(quat, out):
    for n in range(len(quat)):
        w, x, y, z = quat[n, 0], quat[n, 1], quat[n, 2], quat[n, 3]
        out[n, 0] = 2 * (x * z + w * y)
        out[n, 1] = 2 * (y * z - w * x)
        out[n, 2] = 1 - 2 * (x * x + y * y)


def quat_to_matrix(quat_wxyz: Array) -> Array:
    """Rotation matrices, shape (..., 3, 3), from unit quaternions (..., 4)."""
    matrix = np.empty((*quat_wxyz.shape[:-1], 3, 3))
    matrices(quat_wxyz.reshape(-1, 4), matrix.reshape(-1, 3, 3))
    return matrix


@numba.njit(cache=True)
def matrices(quat, out):
    """Write rotation matrices (N, 3, 3) from unit quaternions (N, 4)."""
    for n in range(len(quat)):
        w, x, y, z = quat[n, 0], quat[n, 1], quat[n, 2], quat[n, 3]
        out[n, 0, 0], out[n, 1, 1] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z)
        out[n, 2, 2] = 1 - 2 * (x * x + y * y)
        out[n, 0, 1], out[n, 1, 0] = 2 * (x * y - w * z), 2 * (x * y + w * z)
        out[n, 0, 2], out[n, 2, 0] = 2 * (x * z + w * y), 2 * (x * z - w * y)
        out[n, 1, 2], out[n, 2, 1] = 2 * (y * z - w * x), 2 * (y * z + w * x)


def quat_from_z_axis(axis: Array) -> Array:
    """Shortest rotations, shape (..., 4) w x y z, from z to the unit vectors `axis`."""
    x, y, z = np.moveaxis(axis, -1, 0)
    quat = np.stack([1 + z, -y, x, np.zeros_like(z)], axis=-1)
    quat[1 + z < 1e-12] = (0.0, 1.0, 0.0, 0.0)
    return quat / np.linalg.norm(quat, axis=-1, keepdims=True)
