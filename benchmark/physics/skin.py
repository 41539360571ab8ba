"""Taxels under a known press, compared with distances from plane geometry."""

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from backends import trx
from backends.engine import Engine
from backends.spec import Fingertip, Spec
from backends.state import Array, State
from backends.touch import THRESHOLD_M, Skin, taxel_grid
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.rigs import DT_S, LEVER_M, STICK, TOUCHING_M

LIGHT_N, FIRM_N = 0.5, 4.0
LEAN_RAD, OFFSET_M = 0.3, 0.003
"""Position of the stick on the two pads: tilted, and away from their middle."""
SLACK_M = THRESHOLD_M / 4


def taxels(engine: type[Engine]) -> Iterator[Check]:
    """Press a stick on the skin at a known place, lightly and firmly."""
    spec = rigs.pinch(weightless_s=1.0)
    light, firm = (Skin([spec]).feel(_pressed(engine, spec, n)) for n in (LIGHT_N, FIRM_N))
    depth = np.stack([_depth_m(tip) for tip in spec.hand.fingertips])
    sunk = [_largest((r.reading_m[0] - THRESHOLD_M - depth)[depth > 0]) for r in (light, firm)]
    wrong = light.active[0] != (depth > 0)
    yield Check(
        name="taxels at 0.5 N, wrong ones",
        figure=float((wrong & (np.abs(depth) > SLACK_M)).sum()),
        unit="of 256",
        expected=0.0,
        bound=0.0,
        why="distances from the stick's axis; taxels within 0.05 mm of the edge are left out",
    )
    yield Check(
        name="taxels at 0.5 N, contact centre",
        figure=1e3 * float(np.abs(light.center_m[0] - _centers(spec, depth > 0)).max()),
        unit="mm off",
        expected=0.0,
        bound=1e3 * _row_m() / 2,
        why="mean of the taxels that should be active; bound: half a row, for a taxel at the edge",
    )
    for force, sinking, bound, why in (
        (LIGHT_N, sunk[0], SLACK_M, "bound: a quarter of the depth at which a taxel is active"),
        (
            FIRM_N,
            sunk[1],
            spec.hand.taxels.reach_m,
            "bound: deeper sinking would look like overlap",
        ),
    ):
        yield Check(
            name=f"sinking of the stick into the skin at {force:g} N",
            figure=1e3 * sinking,
            unit="mm",
            expected=0.0,
            bound=1e3 * bound,
            why=f"contacts are hard, or nearly hard; {why}",
        )


def _pressed(engine: type[Engine], spec: Spec, force_n: float) -> State:
    """The pinch after 0.5 s under this force."""
    start = rollout.at_rest([spec], 0.0, (LEVER_M + OFFSET_M, 0.0, 0.0), _axis())
    idle = rollout.idle([spec], round(0.5 / DT_S))
    path = rollout.record(engine, [spec], start, idle, -force_n * (LEVER_M + OFFSET_M))
    return State(**{f.name: getattr(path, f.name)[-1] for f in dataclasses.fields(State)})


def _largest(values: Array) -> float:
    """The value farthest from zero."""
    return float(values[np.argmax(np.abs(values))])


def _axis() -> Array:
    return np.array([math.sin(LEAN_RAD), 0.0, math.cos(LEAN_RAD)])


def _depth_m(tip: Fingertip) -> Array:
    """Depth of the stick's surface in the skin's reach at each taxel [m], shape (T,)."""
    grid, _ = taxel_grid(tip, trx.HAND.taxels)
    frame = np.array([tip.forward, tip.inward, np.cross(tip.forward, tip.inward)])
    center = np.array([OFFSET_M - tip.length_m / 2, TOUCHING_M, 0.0])
    distance = np.linalg.norm(np.cross(grid - center, frame @ _axis()), axis=1) - STICK.radius_m
    return trx.HAND.taxels.reach_m - distance


def _centers(spec: Spec, active: Array) -> Array:
    """Mean position of active taxels per fingertip [m], shape (F, 3)."""
    grids = [taxel_grid(tip, spec.hand.taxels)[0] for tip in spec.hand.fingertips]
    return np.stack([grid[on].mean(axis=0) for grid, on in zip(grids, active, strict=True)])


def _row_m() -> float:
    """Distance between rows of taxels along the finger [m]."""
    length = trx.TIP_LENGTH_M + trx.TIP_RADIUS_M * trx.HAND.taxels.front_rad
    return length / (trx.HAND.taxels.rows - 1)
