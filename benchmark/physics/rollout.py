"""Run worlds for checks: from rest, under given targets and loads, with every state stored."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from backends.engine import Engine
from backends.spec import Spec, Vec3
from backends.state import Array, InitialState, State, quat_from_z_axis

UP: Vec3 = (0.0, 0.0, 1.0)


def at_rest(
    specs: Sequence[Spec],
    joint_rad: Array | float = 0.0,
    stick_m: Array | Vec3 = (1.0, 0.0, 0.0),
    stick_axis: Array | Vec3 = UP,
) -> InitialState:
    """Initial joints and sticks, alike in all worlds or by row; the stick is far off by default."""
    n, joints = len(specs), len(specs[0].hand.joint_names)
    axes = np.broadcast_to(np.array(stick_axis, dtype=float), (n, 3))
    return InitialState(
        joint_rad=np.broadcast_to(np.array(joint_rad, dtype=float), (n, joints)).copy(),
        stick_pos_m=np.broadcast_to(np.array(stick_m, dtype=float), (n, 3)).copy(),
        stick_quat_wxyz=quat_from_z_axis(axes),
    )


def record(
    engine: type[Engine],
    specs: Sequence[Spec],
    start: InitialState,
    target_rad: Array,
    load_nm: Array | float = 0.0,
) -> State:
    """The states after every period in fresh worlds, stacked: arrays (T, N, ...).

    Targets are (T, N, J); loads are broadcast to them.
    """
    load = np.broadcast_to(np.array(load_nm, dtype=float), target_rad.shape)
    worlds = engine(specs)
    try:
        worlds.reset(start, np.ones(len(specs), dtype=bool))
        names = [f.name for f in dataclasses.fields(State)]
        rows = []
        for target, push in zip(target_rad, load, strict=True):
            state = worlds.advance(target, push.copy())
            rows.append([getattr(state, name).copy() for name in names])
    finally:
        worlds.close()
    return State(**{name: np.stack(column) for name, *column in zip(names, *rows, strict=True)})


def idle(specs: Sequence[Spec], periods: int) -> Array:
    """Zero targets (T, N, J), for worlds whose drives do nothing."""
    return np.zeros((periods, len(specs), len(specs[0].hand.joint_names)))
