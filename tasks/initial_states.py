"""How episodes begin: initial states by the paper's Algorithm 1, and the streams that draw them.

Algorithm 1: the fingers close on a stick that is held still.
The paper closes the fingers in simulation until they touch. Here the touching angle is found by
bisection on the distance between fingertip and stick, which needs neither engine nor cache.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numba
import numpy as np

from backends.kinematics import common_hand, tip_frames
from backends.spec import Spec
from backends.state import Array, InitialState, quat_from_z_axis, quat_to_matrix
from backends.touch import stick_shape, surface_distance

TILT_RAD = 0.10
"""Stick axis: both horizontal components of the tilt are uniform within plus and minus this
[rad]."""
PIVOT_M = 3e-3
"""Pinched point: uniform within plus and minus this in x and y about the nominal grip [m]."""
AXIAL_M = 6e-3
"""Place along the stick at which it is pinched: uniform within plus and minus this about the
nominal point [m]."""
DISTAL_RAD = 0.12
"""Distal joints: uniform within plus and minus this about the nominal grasp [rad]."""
STARTS_PER_WORLD = 8
"""Number of initial states from which each world draws its episodes."""
_SWEEP_RAD = 0.5
"""Angle by which the proximal joints open and close about the nominal grasp in search of contact
[rad]."""
_BISECTIONS, _SECTIONS = 40, 40
_GOLDEN = 0.6180339887498949


def sample_initial_states(
    specs: Sequence[Spec], rng: np.random.Generator, spread: float = 1.0
) -> InitialState:
    """One grasp per spec with every finger touching the stick; `spread` scales the distributions.

    The first k grasps of a longer list equal those of a list of k.

    Raises ValueError if a finger cannot touch the stick anywhere in its sweep, or if hands differ.
    """
    hand, n = common_hand(specs), len(specs)
    proximal, distal = _split(specs[0])
    draws = spread * rng.uniform(-1, 1, (n, 5 + len(distal)))
    tilt = TILT_RAD * draws[:, :2]
    axis = np.concatenate([tilt, np.sqrt(1 - (tilt**2).sum(axis=1, keepdims=True))], axis=1)
    grip = np.array(hand.grip_m) + np.pad(PIVOT_M * draws[:, 2:4], ((0, 0), (0, 1)))
    above = np.array([[s.stick.length_m / 2 - s.stick.grip_to_lower_end_m] for s in specs])
    stick_pos = grip + axis * (above + AXIAL_M * draws[:, 4:5])
    quat = quat_from_z_axis(axis)
    joint = np.tile(np.array(hand.grasp_rad), (n, 1))
    joint[:, distal] += DISTAL_RAD * draws[:, 5:]
    _close(specs, joint, proximal, stick_pos, quat)
    return InitialState(joint_rad=joint, stick_pos_m=stick_pos, stick_quat_wxyz=quat)


def _split(spec: Spec) -> tuple[list[int], list[int]]:
    """Columns of each finger's proximal joint and of its distal joint."""
    names = [body.name for body in spec.hand.driven]
    distal = [names.index(tip.body) for tip in spec.hand.fingertips]
    bodies = {body.name: body for body in spec.hand.bodies}
    proximal = [names.index(str(bodies[tip.body].parent)) for tip in spec.hand.fingertips]
    return proximal, distal


def _close(
    specs: Sequence[Spec], joint: Array, proximal: list[int], stick_pos: Array, quat: Array
) -> None:
    """Bisect the proximal angles in `joint` until the distance of each tip to the stick is zero."""
    shapes = np.array([stick_shape(s.stick) for s in specs])
    rotation = quat_to_matrix(quat)
    closed = joint[:, proximal] + _SWEEP_RAD
    opened = joint[:, proximal] - _SWEEP_RAD

    def gap(angles: Array) -> Array:
        joint[:, proximal] = angles
        return distances_m(specs[0], joint, shapes, stick_pos, rotation)

    if (gap(opened) <= 0).any() or (gap(closed) >= 0).any():
        raise ValueError("a finger cannot touch the stick: check the grip, the stick and the hand")
    for _ in range(_BISECTIONS):
        middle = (opened + closed) / 2
        outside = gap(middle) > 0
        opened, closed = np.where(outside, middle, opened), np.where(outside, closed, middle)
    joint[:, proximal] = opened


def distances_m(
    spec: Spec, joint: Array, shapes: Array, stick_pos: Array, rotation: Array
) -> Array:
    """Distance of every tip's surface to the stick's in N worlds (N, F) [m], negative inside.

    Of joints (N, J), and sticks by `stick_shape` (N, 3), centre (N, 3) and rotation (N, 3, 3).
    """
    origin, frame = tip_frames(spec.hand, joint)
    tips = np.array([(tip.length_m, tip.radius_m) for tip in spec.hand.fingertips])
    forward = np.ascontiguousarray(frame[..., 0])
    return _capsule_gaps(origin, forward, tips, shapes, stick_pos, rotation)


@numba.njit(cache=True)
def _at(p, d, s, shape):
    return surface_distance(p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2], shape)


@numba.njit(cache=True)
def _capsule_gaps(origin, forward, tips, shapes, stick_pos, rotation):
    """Distance from tip to stick: golden-section search along the tip's axis (convex)."""
    out = np.empty(origin.shape[:2])
    for n in range(out.shape[0]):
        for f in range(out.shape[1]):
            p, d = np.zeros(3), np.zeros(3)
            for i in range(3):
                for k in range(3):
                    p[i] += rotation[n, k, i] * (origin[n, f, k] - stick_pos[n, k])
                    d[i] -= rotation[n, k, i] * forward[n, f, k] * tips[f, 0]
            low, high = 0.0, 1.0
            for _ in range(_SECTIONS):
                a = high - _GOLDEN * (high - low)
                b = low + _GOLDEN * (high - low)
                if _at(p, d, a, shapes[n]) < _at(p, d, b, shapes[n]):
                    high = b
                else:
                    low = a
            out[n, f] = min(_at(p, d, low, shapes[n]), _at(p, d, high, shapes[n])) - tips[f, 1]
    return out


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The draws of an episode of each of N worlds."""

    start: InitialState
    heading_rad: Array
    """Heading of the figure [rad], shape (N,)."""
    cut: Array
    """Step at which a staggered episode is cut, shape (N,)."""


class Draws(Protocol):
    """Streams of draws."""

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """New episodes for the masked worlds; the rows of others mean nothing.

        `start` replaces the drawn initial states.
        """
        ...


class SharedDraws:
    """One stream for all worlds."""

    def __init__(self, specs: Sequence[Spec], seed: int, spread: float, horizon: int) -> None:
        self._specs, self._spread, self._horizon = specs, spread, horizon
        self._rng = np.random.default_rng(seed)
        self._noise_rng = np.random.default_rng([seed, 1])
        self._starts: list[InitialState] = []

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """See `Draws.episodes`; draws for all worlds, whatever the mask."""
        worlds = len(self._specs)
        start = self._start() if start is None else start
        heading = self._rng.uniform(0, 2 * math.pi, worlds)
        cut = self._rng.integers(1, self._horizon + 1, worlds)
        noise = self._noise_rng.integers(1 << 53, size=worlds)
        return Drawn(start=replace(start, noise_seed=noise), heading_rad=heading, cut=cut)

    def _start(self) -> InitialState:
        if not self._starts:
            self._starts = [
                sample_initial_states(self._specs, self._rng, self._spread)
                for _ in range(STARTS_PER_WORLD)
            ]
        return self._starts[self._rng.integers(STARTS_PER_WORLD)]


class OwnDraws:
    """A stream per world: an episode does not hang on the other worlds."""

    def __init__(
        self, specs: Sequence[Spec], seeds: Sequence[int], spread: float, horizon: int
    ) -> None:
        pairs = zip(specs, seeds, strict=True)
        self._worlds = [SharedDraws([spec], seed, spread, horizon) for spec, seed in pairs]

    def episodes(self, mask: Array, start: InitialState | None) -> Drawn:
        """See `Draws.episodes`."""
        one = np.ones(1, dtype=bool)
        drawn = {
            i: self._worlds[i].episodes(one, None if start is None else _row(start, i))
            for i in np.flatnonzero(mask).tolist()
        }

        def rows(parts: dict[int, Array]) -> Array:
            first = next(iter(parts.values()))
            whole = np.zeros((len(self._worlds), *first.shape[1:]), first.dtype)
            for i, part in parts.items():
                whole[i] = part[0]
            return whole

        names = [field.name for field in fields(InitialState)]
        starts = {n: rows({i: getattr(d.start, n) for i, d in drawn.items()}) for n in names}
        return Drawn(
            start=InitialState(**starts),
            heading_rad=rows({i: d.heading_rad for i, d in drawn.items()}),
            cut=rows({i: d.cut for i, d in drawn.items()}),
        )


def _row(start: InitialState, world: int) -> InitialState:
    rows = {f.name: getattr(start, f.name)[[world]] for f in fields(start)}
    return InitialState(**rows)
