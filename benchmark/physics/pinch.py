"""A stick pinched by two fingertips with a known force: slip, spin and swing.

Thresholds are read from a row of worlds that differ only in gravity.
"""

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from backends import trx
from backends.engine import Engine
from backends.spec import Spec
from backends.state import Array, State, quat_z_axis
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.closed import pendulum_period_s, upward_crossings_s
from benchmark.physics.rigs import DT_S, G_M_S2, LEVER_M, STICK

SQUEEZE_N, FRICTION = 4.0, 0.3
GRIP_N = 2 * FRICTION * SQUEEZE_N
"""The force that two contacts hold by Coulomb's law [N]."""
SETTLE_S, PULL_S = 0.1, 0.1
SHARES = 1 + 0.02 * (np.arange(12) - 5.5)
"""Pulls over the expected threshold; none equals the threshold."""
STEP = 0.02
MOVES = STEP / 4
"""A stick has moved if it gained more than this share of the momentum that the pull alone would
give. The smallest pull beyond the threshold (by STEP / 2) gives twice this; creep gives almost
nothing."""
DIRECTIONS = {"along the stick": 0.0, "across it": math.pi / 2, "on the diagonal": math.pi / 4}
"""Angles of the pull in the tangent plane, from the stick's axis."""


def slip(engine: type[Engine]) -> Iterator[Check]:
    """Pull the stick in the plane of its contacts until it slips."""
    pyramid = "pyramid" in engine.support["stick.friction"]
    for where, angle in DIRECTIONS.items():
        corner = pyramid and where == "on the diagonal"
        expected = math.sqrt(2.0) if corner else 1.0
        pull = np.array([math.sin(angle), 0.0, -math.cos(angle)])
        pulls = expected * SHARES * GRIP_N / STICK.mass_kg
        path = _pinched(engine, [_pulled(pull * size) for size in pulls])
        gained = path.stick_vel_m_s[-1] @ pull / (pulls * PULL_S)
        yield Check(
            name=f"slip {where}, threshold over mu times squeeze",
            figure=expected * _threshold(gained),
            unit="1",
            expected=expected,
            bound=STEP * expected,
            why="the corner of a friction pyramid, sqrt 2" if corner else "Coulomb's cone",
        )
        if where == "along the stick":
            yield _sliding(path, float(pulls[-1]))


def _sliding(path: State, pull_m_s2: float) -> Check:
    """Friction on the stick with the largest pull, from its momentum."""
    steps = round(PULL_S / DT_S)
    kept = STICK.mass_kg * (pull_m_s2 * PULL_S + path.stick_vel_m_s[-1, -1, 2])
    pressed = np.linalg.norm(path.contact_force_n[-steps:, -1], axis=-1).sum() * DT_S
    return Check(
        name="sliding along the stick, friction over mu times normal force",
        figure=float(kept / (FRICTION * pressed)),
        unit="1",
        expected=1.0,
        bound=0.01,
        why="Coulomb's law, over impulses of 0.1 s: soft contacts bounce while they slide",
    )


def spin(engine: type[Engine]) -> Iterator[Check]:
    """Turn the stick about the line through its contacts by its own weight."""
    radius, arm = trx.CONTACT.torsion_radius_m, 0.03
    taken = "taken as 0" not in engine.support["contact.torsion_radius_m"]
    shares = SHARES if taken else SHARES - SHARES[0] + STEP / 2
    pulls = shares * GRIP_N * radius / arm / STICK.mass_kg
    path = _pinched(engine, [_pulled(np.array([p, 0.0, 0.0])) for p in pulls], rise_m=-arm)
    inertia = STICK.inertia_kgm2[0] + STICK.mass_kg * arm**2
    gained = np.abs(path.stick_omega_rad_s[-1, :, 1]) * inertia
    gained /= STICK.mass_kg * pulls * arm * PULL_S
    resisted = float(np.abs((1 - gained) * shares).max())
    yield Check(
        name="spin at the pinch, threshold over mu times squeeze times radius",
        figure=_threshold(gained) if taken else resisted,
        unit="1",
        expected=1.0 if taken else 0.0,
        bound=STEP,
        why="spin friction, as the engine supports contact.torsion_radius_m",
    )


def swing(engine: type[Engine]) -> Iterator[Check]:
    """Let the stick swing about its pinched point without spin friction; check its inertia."""
    offset, amplitude, time_s = 0.06, 0.2, 2.0
    stick = dataclasses.replace(STICK, friction=1.0)
    spec = rigs.pinch(stick=stick, torsion_radius_m=0.0, weightless_s=SETTLE_S)
    axis = np.array([math.sin(amplitude), 0.0, math.cos(amplitude)])
    grip = np.array([LEVER_M, 0.0, 0.0])
    start = rollout.at_rest([spec], 0.0, grip - offset * axis, axis)
    idle = rollout.idle([spec], round((SETTLE_S + time_s) / DT_S))
    path = rollout.record(engine, [spec], start, idle, -SQUEEZE_N * LEVER_M)
    upper = quat_z_axis(path.stick_quat_wxyz[:, 0])
    crossings = upward_crossings_s(np.arctan2(upper[:, 0], upper[:, 2]), DT_S)
    inertia = stick.inertia_kgm2[0] + stick.mass_kg * offset**2
    moment = stick.mass_kg * G_M_S2 * offset
    yield Check(
        name="swing of the pinched stick, period",
        figure=float(np.diff(crossings).mean()),
        unit="s",
        expected=pendulum_period_s(inertia, moment, amplitude),
        bound=2e-4,
        why="compound pendulum; contacts that creep move the pivot by tenths of a millimetre",
    )


def _pulled(gravity_m_s2: Array) -> Spec:
    """The pinch with this gravity, which acts after the squeeze has settled."""
    stick = dataclasses.replace(STICK, friction=FRICTION)
    return rigs.under(rigs.pinch(stick=stick, weightless_s=SETTLE_S), gravity_m_s2)


def _pinched(engine: type[Engine], specs: list[Spec], rise_m: float = 0.0) -> State:
    """Sticks held upright, their centre `rise_m` above the pinch, and then pulled by gravity."""
    start = rollout.at_rest(specs, 0.0, (LEVER_M, 0.0, rise_m))
    idle = rollout.idle(specs, round((SETTLE_S + PULL_S) / DT_S))
    return rollout.record(engine, specs, start, idle, -SQUEEZE_N * LEVER_M)


def _threshold(gained: Array) -> float:
    """The share between the last pull that holds and the first that moves, else NaN."""
    moves = gained > MOVES
    first = int(np.argmax(moves))
    return float(SHARES[first] - STEP / 2) if first > 0 and moves[first:].all() else math.nan
