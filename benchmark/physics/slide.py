"""What a contact does while it slides: whether it stays closed, and how far it resists spin."""

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from backends import trx
from backends.engine import Engine
from backends.spec import Spec
from benchmark.physics import rigs, rollout
from benchmark.physics.check import Check
from benchmark.physics.pinch import FRICTION, GRIP_N, SQUEEZE_N
from benchmark.physics.rigs import DT_S, LEVER_M, STICK

LIGHT_N = 0.1
"""A squeeze that does not hold the stick: its friction is 1 and it weighs 0.29 N."""
SETTLE_S, SLIDE_S = 0.05, 0.2
PULL = 0.8
"""Pull along the stick over the one at which it slips."""
ARM_M, TURN_S = 0.03, 0.1
SHARES = np.arange(0.05, 1.3, 0.05)
"""Spin torques over the one that contacts hold without a pull."""
TURNS = 0.02
"""A stick turns if it gained more than this share of the momentum that the torque would give."""


def touch(engine: type[Engine]) -> Iterator[Check]:
    """Let the stick slide through a grip that is too light for it."""
    spec = rigs.pinch(weightless_s=SETTLE_S)
    start = rollout.at_rest([spec], 0.0, (LEVER_M, 0.0, 0.0))
    idle = rollout.idle([spec], round((SETTLE_S + SLIDE_S) / DT_S))
    path = rollout.record(engine, [spec], start, idle, -LIGHT_N * LEVER_M)
    sliding = path.contact_force_n[round(2 * SETTLE_S / DT_S) : round(SLIDE_S / DT_S), 0]
    bounces = "contact.touch_n" in engine.own
    yield Check(
        name="sliding in a grip of 0.1 N, share of the time without contact",
        figure=float((~sliding.any(axis=-1)).mean()),
        unit="1",
        expected=1.0 if bounces else 0.0,
        bound=0.2,
        why="a soft contact that slides is pushed off the surface" if bounces else "it is pressed",
    )


def spin(engine: type[Engine]) -> Iterator[Check]:
    """Turn the stick at the pinch while it is pulled, from a torque below the threshold on."""
    shared = "ellipsoid" in engine.support["contact.spin_radius_m"]
    specs = [_turned(engine, share) for share in SHARES]
    start = rollout.at_rest(specs, 0.0, (LEVER_M, 0.0, -ARM_M))
    idle = rollout.idle(specs, round((2 * SETTLE_S + TURN_S) / DT_S))
    path = rollout.record(engine, specs, start, idle, -SQUEEZE_N * LEVER_M)
    inertia = STICK.inertia_kgm2[0] + STICK.mass_kg * ARM_M**2
    given = SHARES * GRIP_N * trx.CONTACT.torsion_radius_m * TURN_S
    turns = np.abs(path.stick_omega_rad_s[-1, :, 1]) * inertia / given > TURNS
    yield Check(
        name="spin under 0.8 of the pull that slips, threshold over that without a pull",
        figure=float(SHARES[np.argmax(turns)] - 0.025) if turns.any() else math.nan,
        unit="1",
        expected=math.sqrt(1 - PULL**2) if shared else 1.0,
        bound=0.15,
        why="slip and spin share an ellipsoid" if shared else "spin friction has its own bound",
    )


def _turned(engine: type[Engine], share: float) -> Spec:
    """The pinch with the nominal spin friction, under a pull and a share of the torque it holds."""
    radius_m = trx.CONTACT.torsion_radius_m
    aside = share * GRIP_N * radius_m / ARM_M / STICK.mass_kg
    along = -PULL * GRIP_N / STICK.mass_kg
    stick = dataclasses.replace(STICK, friction=FRICTION)
    spec = rigs.under(
        rigs.pinch(stick=stick, weightless_s=2 * SETTLE_S), np.array([aside, 0.0, along])
    )
    return rigs.spinning(spec, engine, radius_m)
