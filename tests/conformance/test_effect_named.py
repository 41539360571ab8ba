"""Every effect that shows in free air is named from a log of a hand that has it."""

import pytest

from backends import trx
from backends.effect import with_effects
from backends.shard import simulate
from backends.sticks import STICKS
from benchmark import registry
from diagnosis.blind.draw import SIZES
from diagnosis.models.catalogue import catalogue
from diagnosis.recording.record import Plan, record
from diagnosis.solver import solve

IDEAL = trx.spec(STICKS["reference"])
JOINT = "J3"
PLAN = Plan(
    protocols=("steps", "triangle", "multisine", "push"),
    variants=1,
    channels=("command", "position", "torque", "push"),
    seed=3,
)
QUICK = ("coulomb-friction", "encoder-bias")


def large(name: str) -> float:
    """A magnitude that nobody overlooks [SI], as the blind check draws it."""
    size, drive = (
        SIZES[name],
        next(body.joint.drive for body in IDEAL.hand.driven if body.joint.name == JOINT),
    )
    amount = size.levels[2] or -(size.falls or size.levels)[2]
    return amount * (getattr(drive, size.of) if size.of else 1.0)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.slow) for n in SIZES]
)
def test_a_large_effect_is_named(name):
    """Name the effect, on its joint where it has one, with the truth near its interval."""
    kind = catalogue()[name]
    effect = kind(magnitude=large(name), joint=JOINT if kind.per_joint else None)
    engine = registry.load("backend", "mujoco")
    log = record(lambda specs: simulate(engine, specs, 1), with_effects(IDEAL, [effect]), PLAN, "x")
    found = solve(log, nominal=IDEAL)
    assert found.verdict == (name,)
    assert found.joints == ((JOINT,) if kind.per_joint else found.joints)
