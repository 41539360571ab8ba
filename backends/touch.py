"""Touch: taxels, contact centres and binary contact, one code for all engines.

A taxel is active when its fingertip carries force and the stick's surface is nearer to the taxel
than the compliance of the skin: a distance, so no engine needs hundreds of contact geoms.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from backends.kinematics import common_hand, tip_frames
from backends.spec import Fingertip, Spec, Stick, Taxels
from backends.state import Array, State, quat_to_matrix


@dataclass(frozen=True, kw_only=True)
class Touch:
    """What the skin of N worlds feels; overwritten at every reading."""

    active: Array
    """Active taxels, shape (N, F, T), bool; row by row from the rear of the pad to its front."""
    center_m: Array
    """Mean position of a tip's active taxels in its fingertip frame [m], (N, F, 3); 0 if none."""
    in_contact: Array
    """Whether any taxel of a tip is active, shape (N, F), bool."""


def taxel_grid(tip: Fingertip, taxels: Taxels) -> tuple[Array, Array]:
    """Taxel positions [m] and outward unit normals, both (T, 3), in the fingertip frame.

    Rows are spread evenly along the cylinder and then the front hemisphere, columns across.
    """
    arc = np.linspace(-tip.length_m, tip.radius_m * taxels.front_rad, taxels.rows)
    across = np.linspace(-taxels.half_width_rad, taxels.half_width_rad, taxels.columns)
    arc, across = (a.ravel() for a in np.meshgrid(arc, across, indexing="ij"))
    front = np.maximum(arc, 0) / tip.radius_m
    normals = np.stack(
        [np.sin(front) * np.cos(across), np.cos(front) * np.cos(across), np.sin(across)], axis=1
    )
    positions = tip.radius_m * normals
    positions[:, 0] += np.minimum(arc, 0)
    return positions, normals


def stick_shape(stick: Stick) -> tuple[float, float, float]:
    """What `surface_distance` needs: round (1) or square (0), half length, radius [m]."""
    if stick.shape not in ("capsule", "box"):
        raise ValueError(f"no stick shape '{stick.shape}'; known: capsule, box")
    is_round = stick.shape == "capsule"
    half = stick.length_m / 2 - (stick.radius_m if is_round else 0.0)
    return (float(is_round), half, stick.radius_m)


@numba.njit(cache=True)
def surface_distance(x, y, z, shape):
    """Signed distance [m] from a point in the stick's frame to its surface, negative inside."""
    is_round, half, r = shape[0], shape[1], shape[2]
    if is_round > 0.5:
        over = max(abs(z) - half, 0.0)
        return np.sqrt(x * x + y * y + over * over) - r
    dx, dy, dz = abs(x) - r, abs(y) - r, abs(z) - half
    ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return np.sqrt(ox * ox + oy * oy + oz * oz) + min(max(dx, max(dy, dz)), 0.0)


@numba.njit(cache=True)
def _feel(force, origin, rotation, stick_pos, stick_rot, shape, grid, reach, active, center, touch):
    for n in range(force.shape[0]):
        for f in range(force.shape[1]):
            active[n, f, :] = False
            center[n, f, :] = 0.0
            touch[n, f] = False
            fx, fy, fz = force[n, f]
            if fx * fx + fy * fy + fz * fz <= 0.0:
                continue
            a = np.zeros((3, 3))
            b = np.zeros(3)
            for i in range(3):
                for k in range(3):
                    b[i] += stick_rot[n, k, i] * (origin[n, f, k] - stick_pos[n, k])
                    for j in range(3):
                        a[i, j] += stick_rot[n, k, i] * rotation[n, f, k, j]
            count = 0
            cx, cy, cz = 0.0, 0.0, 0.0
            for t in range(grid.shape[1]):
                u, v, w = grid[f, t, 0], grid[f, t, 1], grid[f, t, 2]
                x = a[0, 0] * u + a[0, 1] * v + a[0, 2] * w + b[0]
                y = a[1, 0] * u + a[1, 1] * v + a[1, 2] * w + b[1]
                z = a[2, 0] * u + a[2, 1] * v + a[2, 2] * w + b[2]
                if surface_distance(x, y, z, shape[n]) < reach[n]:
                    active[n, f, t] = True
                    cx, cy, cz = cx + u, cy + v, cz + w
                    count += 1
            if count > 0:
                center[n, f, 0] = cx / count
                center[n, f, 1] = cy / count
                center[n, f, 2] = cz / count
                touch[n, f] = True


class Skin:
    """The taxels of N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        hand = common_hand(specs)
        self._hand = hand
        self._grid = np.stack([taxel_grid(tip, hand.taxels)[0] for tip in hand.fingertips])
        self._shape = np.array([stick_shape(s.stick) for s in specs])
        self._reach_m = np.array([s.hand.taxels.reach_m for s in specs])
        n, tips, taxels = len(specs), len(hand.fingertips), self._grid.shape[1]
        self.touch = Touch(
            active=np.zeros((n, tips, taxels), dtype=bool),
            center_m=np.zeros((n, tips, 3)),
            in_contact=np.zeros((n, tips), dtype=bool),
        )

    def feel(self, state: State) -> Touch:
        """Read every taxel in the given state."""
        origin, rotation = tip_frames(self._hand, state.joint_rad)
        _feel(
            state.contact_force_n,
            origin,
            np.ascontiguousarray(rotation),
            state.stick_pos_m,
            quat_to_matrix(state.stick_quat_wxyz),
            self._shape,
            self._grid,
            self._reach_m,
            self.touch.active,
            self.touch.center_m,
            self.touch.in_contact,
        )
        return self.touch
