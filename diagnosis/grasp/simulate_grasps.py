"""Worlds put through the commands of a log's grasps, side by side on an engine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array, InitialState, State, quat_z_axis
from diagnosis.motion.batch import states, together
from diagnosis.motion.held import Held

Simulate = Callable[[Sequence[Spec]], Simulator]
"""Puts worlds on an engine."""


GONE_M = 0.1
"""Where all sticks have fallen by this, nothing follows: they stay where they are [m]."""


@dataclass(frozen=True, kw_only=True)
class GraspReplay:
    """One world in one episode, a row per sample of the log."""

    joint_rad: Array
    """Joint angles, shape (T, J)."""
    torque_nm: Array
    """PD torques, shape (T, J)."""
    stick: Array
    """Pose x y z [m], qw qx qy qz, shape (T, 7)."""
    force_n: Array
    """Normal force on every tip, shape (T, F)."""


def ends_m(stick: Array, length_m: float) -> Array:
    """Lower and upper end of a stick in the poses (..., 7) [m], shape (..., 6)."""
    half = length_m / 2 * quat_z_axis(stick[..., 3:])
    return np.concatenate([stick[..., :3] - half, stick[..., :3] + half], axis=-1)


def simulate_grasps(
    simulate: Simulate, worlds: Sequence[Spec], parts: Sequence[Held]
) -> list[list[GraspReplay]]:
    """What every world shows in every episode: a list per world of one per episode.

    Joints and stick start where the log has them; all episodes have one rate.
    """
    dt_s = float(np.median(np.diff(parts[0].time_s)))
    pairs = [(_at_rate(world, dt_s), part) for world in worlds for part in parts]
    start = InitialState(
        joint_rad=np.stack([p.joint_rad[0] for _, p in pairs]),
        stick_pos_m=np.stack([p.stick[0, :3] for _, p in pairs]),
        stick_quat_wxyz=np.stack([p.stick[0, 3:] for _, p in pairs]),
    )
    target, load, pull = (
        together([getattr(part, name) for _, part in pairs])
        for name in ("command_rad", "push_nm", "pull_n")
    )
    rows = []
    for state in states(simulate([world for world, _ in pairs]), start, target, load, pull):
        rows.append(_row(state))
        if (state.stick_pos_m[:, 2] < start.stick_pos_m[:, 2] - GONE_M).all():
            break
    rows += rows[-1:] * (len(target) - len(rows))
    taken = [np.stack(column, axis=1) for column in zip(*rows, strict=True)]
    shown = [
        GraspReplay(**dict(zip(_NAMES, (v[n, : len(p.time_s)] for v in taken), strict=True)))
        for n, (_, p) in enumerate(pairs)
    ]
    count = len(parts)
    return [shown[w * count : (w + 1) * count] for w in range(len(worlds))]


_NAMES = ("joint_rad", "torque_nm", "stick", "force_n")


def _row(state: State) -> tuple[Array, ...]:
    return (
        state.joint_rad.copy(),
        state.drive_torque_nm.copy(),
        np.hstack([state.stick_pos_m, state.stick_quat_wxyz]),
        np.linalg.norm(state.contact_force_n, axis=-1),
    )


def _at_rate(world: Spec, dt_s: float) -> Spec:
    timing = replace(world.timing, policy_s=dt_s)
    return replace(world, timing=timing)
