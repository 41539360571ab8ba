"""Spin friction that is added to a contact holds what the law says, in every engine."""

import dataclasses

import numpy as np
import pytest

from backends import trx
from backends.engine import Engine
from benchmark.errors import CommandError
from benchmark.parts import registry
from benchmark.physics import rigs, rollout
from benchmark.physics.pinch import FRICTION, SQUEEZE_N
from benchmark.physics.rigs import DT_S, LEVER_M, STICK

ARM_M, GRIP_N = 0.03, 2 * FRICTION * SQUEEZE_N
SETTLE_S, TURN_S = 0.1, 0.1


@pytest.fixture(params=registry.names("backend"))
def engine(request: pytest.FixtureRequest) -> type[Engine]:
    """Every engine that is installed."""
    try:
        return registry.load("backend", request.param)
    except CommandError as error:
        pytest.skip(str(error))


def turned(engine: type[Engine], more_m: float, shares: np.ndarray, radius_m: float) -> np.ndarray:
    """Speeds [rad/s] of sticks that a share of the threshold turns at the pinch.

    Their centre is ARM_M below the pinch, and sideways gravity acts on it.
    """
    specs = []
    for share in shares:
        pull = share * GRIP_N * radius_m / ARM_M / STICK.mass_kg
        stick = dataclasses.replace(STICK, friction=FRICTION)
        spec = rigs.under(rigs.pinch(stick=stick, weightless_s=SETTLE_S), np.array([pull, 0, 0]))
        contact = dataclasses.replace(spec.contact, spin_radius_m=more_m)
        specs.append(dataclasses.replace(spec, contact=contact))
    start = rollout.at_rest(specs, 0.0, (LEVER_M, 0.0, -ARM_M))
    idle = rollout.idle(specs, round((SETTLE_S + TURN_S) / DT_S))
    path = rollout.record(engine, specs, start, idle, -SQUEEZE_N * LEVER_M)
    return np.abs(path.stick_omega_rad_s[-1, :, 1])


@pytest.mark.parametrize("more_m", [-1e-3, 2e-3])
def test_spin_friction_is_added_to_the_engines_own(engine: type[Engine], more_m: float) -> None:
    """Hold 0.9 of mu N (own radius + more) and turn at 1.1, or turn freely where that is 0."""
    own_m = trx.CONTACT.torsion_radius_m
    if "taken as 0" in engine.support["contact.torsion_radius_m"]:
        own_m = 0.0
    radius_m = own_m + more_m
    if radius_m <= 0.0:
        slow, fast = turned(engine, more_m, np.array([0.1, 0.2]), 1e-3)
        assert slow > 0.01 and fast == pytest.approx(2 * slow, rel=0.01)
        return
    held, turning = turned(engine, more_m, np.array([0.9, 1.1]), radius_m)
    assert held < 0.2 * turning
