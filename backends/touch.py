"""Touch: taxels, contact centres and binary contact, the same code for all engines.

A taxel reads how deep the stick presses into its skin, as soon as the fingertip carries force. This
is a distance, so no engine needs hundreds of contact geoms. As in the paper, readings are binarised
with a fixed threshold. The faults of real skin are added here: readings stay behind where a press
eases, taxels have gains of their own, readings drift, taxels are dead, neighbours respond too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from backends.kinematics import TipChains, common_hand
from backends.spec import Fingertip, Spec, Stick, Taxels
from backends.state import Array, State, quat_to_matrix

THRESHOLD_M = 0.2e-3
"""Pressed depth above which a reading counts as contact [m]: the paper's empirical threshold.

The skin is thicker than `Taxels.reach_m` by this. So without drift, a taxel is active when the
stick is nearer than `reach_m`.
"""


@dataclass(frozen=True, kw_only=True)
class Touch:
    """Touch readings of N worlds; overwritten at every reading."""

    reading_m: Array
    """Readings: pressed depth [m], (N, F, T); row by row from the rear of the pad to its front."""
    active: Array
    """Active taxels: readings above the threshold, plus those added by a halo, (N, F, T), bool."""
    center_m: Array
    """Contact centre: mean position of a tip's active taxels, fingertip frame [m], (N, F, 3); 0 if
    none."""
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
    """Arguments of `surface_distance`: round (1) or square (0), half length, radius [m]."""
    if stick.shape not in ("capsule", "box"):
        raise ValueError(f"no stick shape '{stick.shape}'; known: capsule, box")
    is_round = stick.shape == "capsule"
    half = stick.length_m / 2 - (stick.radius_m if is_round else 0.0)
    return (float(is_round), half, stick.radius_m)


@numba.njit(cache=True)
def _to_capsule(x, y, z, half, r):
    over = max(abs(z) - half, 0.0)
    return np.sqrt(x * x + y * y + over * over) - r


@numba.njit(cache=True)
def _to_box(x, y, z, half, r):
    dx, dy, dz = abs(x) - r, abs(y) - r, abs(z) - half
    ox, oy, oz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    return np.sqrt(ox * ox + oy * oy + oz * oz) + min(max(dx, max(dy, dz)), 0.0)


@numba.njit(cache=True)
def surface_distance(x, y, z, shape):
    """Signed distance [m] from a point in the stick's frame to its surface, negative inside."""
    is_round, half, r = shape[0], shape[1], shape[2]
    return _to_capsule(x, y, z, half, r) if is_round > 0.5 else _to_box(x, y, z, half, r)


@numba.njit(cache=True)
def _press(
    worlds,
    force,
    origin,
    rotation,
    stick_pos,
    stick_rot,
    shape,
    grid,
    skin,
    time_s,
    rank,
    held,
    reading,
):
    """Write the reading of every taxel of some worlds; frames and sticks belong to those worlds.

    The grid is (F, 3, T), so that many taxels are computed at a time.
    """
    turn, offset = np.empty((3, 3)), np.empty(3)
    for i, n in enumerate(worlds):
        reach, drift, dead, touch_n, gain, stays = skin[n]
        for f in range(force.shape[1]):
            fx, fy, fz = force[n, f]
            if fx * fx + fy * fy + fz * fz > touch_n * touch_n:
                _to_stick(origin[i, f], rotation[i, f], stick_pos[i], stick_rot[i], turn, offset)
                _depths(turn, offset, shape[n], grid[f], reach, reading[n, f])
            else:
                reading[n, f] = 0.0
            if stays > 0.0:
                if time_s[n] == 0.0:
                    held[n, f, :] = 0.0
                ease(stays, reading[n, f], held[n, f])
            if drift != 0.0 or dead != 0.0 or gain != 0.0:
                _spoil(drift * time_s[n], dead, gain, rank[f], reading[n, f])


@numba.njit(cache=True)
def _to_stick(origin, rotation, stick_pos, stick_rot, turn, offset):
    """Write the rotation and offset from a fingertip's frame to the stick's."""
    turn[:], offset[:] = 0.0, 0.0
    for i in range(3):
        for k in range(3):
            offset[i] += stick_rot[k, i] * (origin[k] - stick_pos[k])
            for j in range(3):
                turn[i, j] += stick_rot[k, i] * rotation[k, j]


@numba.njit(cache=True)
def _depths(turn, offset, shape, grid, reach, reading):
    """Pressed depths of the taxels of a grid (3, T), with room for a negative threshold."""
    is_round, half, r = shape[0] > 0.5, shape[1], shape[2]
    for t in range(len(reading)):
        u, v, w = grid[0, t], grid[1, t], grid[2, t]
        x = turn[0, 0] * u + turn[0, 1] * v + turn[0, 2] * w + offset[0]
        y = turn[1, 0] * u + turn[1, 1] * v + turn[1, 2] * w + offset[1]
        z = turn[2, 0] * u + turn[2, 1] * v + turn[2, 2] * w + offset[2]
        round_, box = _to_capsule(x, y, z, half, r), _to_box(x, y, z, half, r)
        pressed = reach - (round_ if is_round else box)
        reading[t] = max(pressed + THRESHOLD_M, 0.0)


@numba.njit(cache=True)
def ease(stays, depth, held):
    """Let depths (T,) be those that `held` shows next: at least now's, at most a share more.

    It is the play operator: a reading stays where a press eases a little, and follows it beyond.
    """
    for t in range(len(depth)):
        held[t] = depth[t] = min(max(held[t], depth[t]), (1.0 + stays) * depth[t])


@numba.njit(cache=True)
def _spoil(drift_m, dead, gain, rank, reading):
    """Multiply readings by gains, add drift and set dead taxels to zero."""
    for t in range(len(reading)):
        read = (1.0 + gain * rank[t, 2]) * reading[t]
        reading[t] = 0.0 if rank[t, 0] < dead else drift_m * rank[t, 1] + read


@numba.njit(cache=True)
def _binarise(worlds, reading, threshold, grid, halo, skin, rank, active, center, touch):
    for n in worlds:
        for f in range(reading.shape[1]):
            count = 0
            for t in range(grid.shape[1]):
                active[n, f, t] = reading[n, f, t] > threshold[n]
            if halo[n] > 0.0:
                alive = rank[f, :, 0] >= skin[n, 2]
                _spread(reading[n, f], threshold[n], grid[f], halo[n], alive, active[n, f])
            cx, cy, cz = 0.0, 0.0, 0.0
            for t in range(grid.shape[1]):
                if active[n, f, t]:
                    cx, cy, cz = cx + grid[f, t, 0], cy + grid[f, t, 1], cz + grid[f, t, 2]
                    count += 1
            touch[n, f] = count > 0
            count = max(count, 1)
            center[n, f, 0] = cx / count
            center[n, f, 1] = cy / count
            center[n, f, 2] = cz / count


@numba.njit(cache=True)
def _spread(reading, threshold, grid, halo, alive, active):
    """Activate the neighbours of pressed taxels, except dead ones."""
    for t in range(grid.shape[0]):
        for s in range(grid.shape[0]):
            if alive[t] and reading[s] > threshold:
                x, y, z = grid[t] - grid[s]
                if x * x + y * y + z * z < halo * halo:
                    active[t] = True


def _ranks(tips: int, taxels: int) -> Array:
    """Three fixed numbers per taxel, (F, T, 3), the same in every world and episode.

    A taxel is dead if the dead share exceeds its first number. These numbers are evenly spaced, so
    the share is met exactly. Its drift is the second number, in [0, 1), times the fastest drift.
    Its gain differs from 1 by the third, in [-1, 1), times the spread.
    """
    rng = np.random.default_rng(0)
    dies = rng.permuted(np.tile(np.arange(taxels) / taxels, (tips, 1)), axis=1)
    drifts, gains = rng.uniform(size=(tips, taxels)), rng.uniform(-1, 1, (tips, taxels))
    return np.stack([dies, drifts, gains], axis=-1)


class Skin:
    """The taxels of N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        hand = common_hand(specs)
        self._chains = TipChains(hand)
        self._grid = np.stack([taxel_grid(tip, hand.taxels)[0] for tip in hand.fingertips])
        self._points = self._grid.swapaxes(1, 2).copy()
        self._shape = np.array([stick_shape(s.stick) for s in specs])
        taxels = [s.hand.taxels for s in specs]
        skins = [(s.hand.taxels, s.contact.touch_n) for s in specs]
        self._skin = np.array(
            [
                (t.reach_m, t.drift_m_s, t.dead_share, n, t.gain_spread, t.hysteresis)
                for t, n in skins
            ]
        )
        self._threshold_m = np.array([THRESHOLD_M + t.threshold_m for t in taxels])
        self._halo_m = np.array([t.halo_m for t in taxels])
        n, shape = len(specs), self._grid.shape[:2]
        self._rank = _ranks(*shape)
        self._held = np.zeros((n, *shape) if self._skin[:, -1].any() else (0, 0, 0))
        self._all, self._no_time_s = np.arange(n), np.zeros(n)
        self.touch = Touch(
            reading_m=np.zeros((n, *shape)),
            active=np.zeros((n, *shape), dtype=bool),
            center_m=np.zeros((n, shape[0], 3)),
            in_contact=np.zeros((n, shape[0]), dtype=bool),
        )

    def feel(self, state: State, time_s: Array | None = None, worlds: Array | None = None) -> Touch:
        """Read every taxel in the given state, `time_s` (N,) after the start; None: at the start.

        `worlds` are the numbers of the worlds to read, the others keep their readings; None: all.
        """
        worlds = self._all if worlds is None else worlds
        origin, rotation = self._chains.frames(state.joint_rad[worlds])
        touch = self.touch
        _press(
            worlds,
            state.contact_force_n,
            origin,
            rotation,
            state.stick_pos_m[worlds],
            quat_to_matrix(state.stick_quat_wxyz[worlds]),
            self._shape,
            self._points,
            self._skin,
            self._no_time_s if time_s is None else time_s,
            self._rank,
            self._held,
            touch.reading_m,
        )
        _binarise(
            worlds,
            touch.reading_m,
            self._threshold_m,
            self._grid,
            self._halo_m,
            self._skin,
            self._rank,
            touch.active,
            touch.center_m,
            touch.in_contact,
        )
        return touch
