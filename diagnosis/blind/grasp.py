"""The episodes of a blind case with the stick in the hand: motions, and its tracker.

The fingers close on the stick, which has no weight until they hold it. Then they move a little, or
hold it until it is pulled out. This module knows no solver.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from backends.spec import Spec
from backends.state import Array
from diagnosis.blind import rigs
from diagnosis.blind.motion import REST_S, Motion, evenly, times_s
from tasks.initial_states import sample_initial_states

HOLDS = GRASP, PULL = "grasp", "pull"
"""Protocols with the stick in the hand."""
SINES, SINE_HZ, SWAY_RAD = 3, (0.3, 3.0), (0.015, 0.04)
"""Number of sines of random frequency, and the largest excursion of a joint about its grip."""
SQUEEZE = (0.8, 1.4)
"""Squeeze of a grasp over the hand's nominal one."""
FALLEN_M = 0.02
"""A stick that has sunk by this counts as fallen, and the episode ends [m]."""
LEAST = 100
"""Smallest number of samples of an episode [1]."""
PULL_AT_S, PULL_N_S = (1.2, 1.6), (70.0, 130.0)
"""Time at which the pull begins, and its growth per second."""


def gripped(protocol: str, world: Spec, rng: np.random.Generator) -> Motion:
    """A random grasp of the stick of a hidden world.

    In it a random small motion, or none until the stick is pulled out of it.
    """
    start = sample_initial_states([world], rng)
    squeeze = rng.uniform(*SQUEEZE) * np.array(world.hand.preload_rad)
    if protocol == GRASP:
        moved = np.stack([_sway(times_s() - REST_S, rng) for _ in squeeze], axis=1)
        pull_n = None
    else:
        since_s = np.maximum(times_s() - rng.uniform(*PULL_AT_S), 0.0)
        moved, pull_n = np.zeros((len(since_s), len(squeeze))), rng.uniform(*PULL_N_S) * since_s
    return Motion(
        protocol=protocol,
        target_rad=start.joint_rad[0] + squeeze + moved,
        push_nm=0.0 * moved,
        start=start,
        pull_n=pull_n,
    )


def _sway(since_s: Array, rng: np.random.Generator) -> Array:
    """A joint's excursion (T,) [rad], zero before it begins."""
    inside_s, phases = np.maximum(since_s, 0.0), rng.uniform(0, 2 * np.pi, SINES)
    pairs = zip(evenly(rng, SINE_HZ, SINES), phases, strict=True)
    moved = sum(np.sin(2 * np.pi * hz * inside_s + at) - np.sin(at) for hz, at in pairs)
    return rng.uniform(*SWAY_RAD) * moved / np.abs(moved).max()


def tracked(pose: Array, rng: np.random.Generator) -> Array:
    """Poses x y z [m], qw qx qy qz (T, 7) with the tracker's noise."""
    turned = Rotation.from_rotvec(rigs.TRACKER_RAD * rng.normal(size=(len(pose), 3)))
    quat = (turned * Rotation.from_quat(pose[:, 3:], scalar_first=True)).as_quat(scalar_first=True)
    quat *= np.where((quat * pose[:, 3:]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return np.hstack([pose[:, :3] + rigs.TRACKER_M * rng.normal(size=(len(pose), 3)), quat])


def fallen(pose: Array) -> int:
    """Number of samples before the stick falls, from poses (T, 7); at least `LEAST`."""
    low = pose[:, 2] < pose[0, 2] - FALLEN_M
    return max(int(np.argmax(low)), LEAST) if low.any() else len(pose)
