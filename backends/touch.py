"""Touch: taxels, contact centres and binary contact, the same code for all engines.

A taxel reads how deep the stick presses into its skin, as soon as the fingertip carries force. This
is a distance, so no engine needs hundreds of contact geoms. As in the paper, readings are binarised
with a fixed threshold. The faults of real skin are added here: readings stay behind where a press
eases, taxels have gains of their own, readings drift, taxels are dead, neighbours respond too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numba
import numpy as np

from backends.kinematics import common_hand, room, tip_chain, tips_placed
from backends.spec import Fingertip, Spec, Stick, Taxels
from backends.state import Array, State, matrices

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
def _read(worlds, joint, pos, quat, force, time_s, chain, skins, touch):
    """Write the reading of every taxel of some worlds, and what follows from it."""
    shape, grid, points, skin, rank, held = skins
    reading, active, center, in_contact = touch
    at, body_turn = room(chain)
    origin, rotation = np.empty((len(grid), 3)), np.empty((len(grid), 3, 3))
    stick_rot, turn, offset = np.empty((1, 3, 3)), np.empty((3, 3)), np.empty(3)
    for n in worlds:
        tips_placed(joint[n], chain, at, body_turn, origin, rotation)
        matrices(quat[n : n + 1], stick_rot)
        reach, drift, dead, touch_n, gain, stays, threshold, halo = skin[n]
        for f in range(len(grid)):
            fx, fy, fz = force[n, f, 0], force[n, f, 1], force[n, f, 2]
            if fx * fx + fy * fy + fz * fz > touch_n * touch_n:
                _to_stick(origin[f], rotation[f], pos[n], stick_rot[0], turn, offset)
                _depths(turn, offset, shape[n], points[f], reach, reading[n, f])
            else:
                reading[n, f] = 0.0
            if stays > 0.0:
                if time_s[n] == 0.0:
                    held[n, f, :] = 0.0
                ease(stays, reading[n, f], held[n, f])
            if drift != 0.0 or dead != 0.0 or gain != 0.0:
                _spoil(drift * time_s[n], dead, gain, rank[f], reading[n, f])
            _binarise(reading[n, f], threshold, active[n, f])
            if halo > 0.0:
                alive = rank[f, :, 0] >= dead
                _spread(reading[n, f], threshold, grid[f], halo, alive, active[n, f])
            in_contact[n, f] = _center(active[n, f], grid[f], center[n, f])


@numba.njit(cache=True, forceinline=True)
def _to_stick(origin, rotation, stick_pos, stick_rot, turn, offset):
    """Write the rotation and offset from a fingertip's frame to the stick's."""
    x, y, z = origin[0] - stick_pos[0], origin[1] - stick_pos[1], origin[2] - stick_pos[2]
    for i in range(3):
        a, b, c = stick_rot[0, i], stick_rot[1, i], stick_rot[2, i]
        offset[i] = a * x + b * y + c * z
        for j in range(3):
            turn[i, j] = a * rotation[0, j] + b * rotation[1, j] + c * rotation[2, j]


@numba.njit(cache=True, forceinline=True)
def _depths(turn, offset, shape, grid, reach, reading):
    """Pressed depths of the taxels of a grid (3, T), with room for a negative threshold.

    The grid lies so that many taxels are computed at a time.
    """
    is_round, half, r = shape[0] > 0.5, shape[1], shape[2]
    for t in range(len(reading)):
        u, v, w = grid[0, t], grid[1, t], grid[2, t]
        x = turn[0, 0] * u + turn[0, 1] * v + turn[0, 2] * w + offset[0]
        y = turn[1, 0] * u + turn[1, 1] * v + turn[1, 2] * w + offset[1]
        z = turn[2, 0] * u + turn[2, 1] * v + turn[2, 2] * w + offset[2]
        apart = _to_capsule(x, y, z, half, r) if is_round else _to_box(x, y, z, half, r)
        reading[t] = max(reach - apart + THRESHOLD_M, 0.0)


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
def _binarise(reading, threshold, active):
    for t in range(len(reading)):
        active[t] = reading[t] > threshold


@numba.njit(cache=True, forceinline=True)
def _center(active, grid, center):
    """Write the mean position of the active taxels; returns whether there are any."""
    x, y, z, count = 0.0, 0.0, 0.0, 0
    for t in range(len(active)):
        if active[t]:
            x, y, z, count = x + grid[t, 0], y + grid[t, 1], z + grid[t, 2], count + 1
    whole = max(count, 1)
    center[0], center[1], center[2] = x / whole, y / whole, z / whole
    return count > 0


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


_STAYS = 5
"""Place of hysteresis among the numbers of a skin."""


def _numbers(spec: Spec) -> tuple[float, ...]:
    """The numbers of a world's skin, as `_read` takes them."""
    t, touch_n = spec.hand.taxels, spec.contact.touch_n
    faults = t.reach_m, t.drift_m_s, t.dead_share, touch_n, t.gain_spread, t.hysteresis
    return *faults, THRESHOLD_M + t.threshold_m, t.halo_m


class Skin:
    """The taxels of N worlds."""

    def __init__(self, specs: Sequence[Spec]) -> None:
        hand = common_hand(specs)
        self._chain = tip_chain(hand)
        grid = np.stack([taxel_grid(tip, hand.taxels)[0] for tip in hand.fingertips])
        skin = np.array([_numbers(spec) for spec in specs])
        n, shape = len(specs), grid.shape[:2]
        self._skins = (
            np.array([stick_shape(s.stick) for s in specs]),
            grid,
            grid.swapaxes(1, 2).copy(),
            skin,
            _ranks(*shape),
            np.zeros((n, *shape) if skin[:, _STAYS].any() else (0, 0, 0)),
        )
        self._all, self._no_time_s = np.arange(n), np.zeros(n)
        self.touch = Touch(
            reading_m=np.zeros((n, *shape)),
            active=np.zeros((n, *shape), dtype=bool),
            center_m=np.zeros((n, shape[0], 3)),
            in_contact=np.zeros((n, shape[0]), dtype=bool),
        )
        self._out = tuple(getattr(self.touch, field.name) for field in fields(Touch))

    def feel(self, state: State, time_s: Array | None = None, worlds: Array | None = None) -> Touch:
        """Read every taxel in the given state, `time_s` (N,) after the start; None: at the start.

        `worlds` are the numbers of the worlds to read, the others keep their readings; None: all.
        """
        worlds = self._all if worlds is None else worlds
        time_s = self._no_time_s if time_s is None else time_s
        pose = state.stick_pos_m, state.stick_quat_wxyz
        seen = state.joint_rad, *pose, state.contact_force_n, time_s
        _read(worlds, *seen, self._chain, self._skins, self._out)
        return self.touch
