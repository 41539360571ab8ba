"""A stick on a shelf of two fixed fingertips: the forces at rest, and a landing."""

from collections.abc import Iterator

import numpy as np

from backends.engine import Engine
from backends.state import State
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check, rounding
from benchmark.physics.rigs import DT_S, G_M_S2, STICK

LEFT_M, RIGHT_M = 0.03, 0.05
"""Distances of the two fingertips from the stick's centre."""
DROP_M, TIME_S = 0.01, 0.5
WEIGHT_N = STICK.mass_kg * G_M_S2


def rest(engine: type[Engine]) -> Iterator[Check]:
    """Lay the stick down off its centre."""
    force = -_lay(engine, 0.0).contact_force_n[-1, 0]
    yield Check(
        name="resting stick, sum of forces over m g",
        figure=float(force[:, 2].sum() / WEIGHT_N),
        unit="1",
        expected=1.0,
        bound=1e-6 + 32 * rounding(engine),
        why="force balance; solvers stop at 1e-8, in 32-bit numbers at 1e-6",
    )
    share = force[:, 2] / WEIGHT_N - np.array([RIGHT_M, LEFT_M]) / (LEFT_M + RIGHT_M)
    yield Check(
        name="resting stick, shares of the two tips",
        figure=float(np.abs(share).max()),
        unit="of m g off",
        expected=0.0,
        bound=1e-4,
        why="lever rule; unequal sinking of 0.01 mm tilts the stick and moves the contacts",
    )


def landing(engine: type[Engine]) -> Iterator[Check]:
    """Drop the stick by 10 mm: the contacts take up all momentum, and it does not bounce."""
    path = _lay(engine, DROP_M)
    impulse = -path.contact_force_n[:, 0, :, 2].sum() * DT_S
    gained = STICK.mass_kg * path.stick_vel_m_s[-1, 0, 2]
    yield Check(
        name="landing, impulse of the contacts over m g t",
        figure=float((impulse - gained) / (WEIGHT_N * TIME_S)),
        unit="1",
        expected=1.0,
        bound=1e-5,
        why="momentum; a 32-bit force rounds at 6e-8, and a landing adds up 50 times the weight",
    )
    height = path.stick_pos_m[:, 0, 2]
    lowest = int(np.argmin(height))
    yield Check(
        name="landing, height after the lowest point over the drop",
        figure=float(max(height[lowest:].max(), 0.0) / DROP_M),
        unit="1",
        expected=0.0,
        bound=0.01,
        why="contacts are inelastic (restitution 0) and give no energy back",
    )


def _lay(engine: type[Engine], drop_m: float) -> State:
    """A stick that is released `drop_m` above the shelf."""
    spec = rigs.shelf(LEFT_M, RIGHT_M)
    start = rollout.at_rest([spec], 0.0, (0.0, 0.0, drop_m), (1.0, 0.0, 0.0))
    return rollout.record(engine, [spec], start, rollout.idle([spec], round(TIME_S / DT_S)))
