"""Every effect of the catalogue, large, is named from a log of a hand that has it.

All of these are slow; the tests of `bench diagnose` and of grasps name a few in less time.
"""

from dataclasses import replace

import pytest

from backends import trx
from backends.catalogue import catalogue
from backends.effect import Effect, with_effects
from backends.shard import simulate
from backends.spec import Spec
from backends.sticks import STICKS
from benchmark.parts import registry
from diagnosis.grasp.in_hand import in_hand
from diagnosis.logs.log import Log
from diagnosis.recording.record import Plan, record
from diagnosis.skin.skin_faults import DEPTHS as OF_DEPTHS
from diagnosis.walk import diagnose

IDEAL = trx.spec(STICKS["reference"])
FREE = Plan(
    protocols=("steps", "triangle", "multisine", "push"),
    variants=1,
    channels=("command", "position", "torque", "push"),
    seed=3,
)
HELD = Plan(
    protocols=("grasp",),
    variants=2,
    channels=("command", "position", "stick", "contact"),
    seed=7,
)
DEEP = replace(HELD, channels=("command", "position", "stick", "touch"))
"""Grasps with depths, not only with yes and no."""
PULLED = replace(HELD, protocols=("grasp", "pull"), channels=(*HELD.channels, "pull"))
DEPTHS = tuple(f"taxels.{fault}" for fault in OF_DEPTHS)
pytestmark = pytest.mark.slow


def named(in_the_hand: bool) -> list[str]:
    """Names of effects that are looked for in free air or in the hand."""
    kinds = catalogue().items()
    return [n for n, kind in kinds if kind.drawn and kind.shows_in_hand() == in_the_hand]


def joint_of(kind: type[Effect]) -> str | None:
    """A joint that may have it."""
    if not kind.per_joint:
        return None
    return IDEAL.hand.ends[0].joint.name if kind.at_ends else "J3"


def large(kind: type[Effect]) -> Effect:
    """The effect at a size that nobody overlooks, as the blind check draws it."""
    joint = joint_of(kind)
    drive = next(b.joint.drive for b in IDEAL.hand.driven if joint in (None, b.joint.name))
    return kind(magnitude=kind.levels[-1] * kind.natural(drive), joint=joint)


def on_mujoco(specs: list[Spec]):
    return simulate(registry.load("backend", "mujoco"), specs, 1)


def log(name: str, plan: Plan) -> Log:
    """The log of a hand with an effect."""
    kind = catalogue()[name]
    return record(on_mujoco, with_effects(nominal(kind), [large(kind)]), plan, "x")


def nominal(kind: type[Effect]) -> Spec:
    """The hand as it should be, tilted where an effect shows by weight alone."""
    return catalogue()["gravity-tilt"](magnitude=0.5).on_spec(IDEAL) if kind.by_weight else IDEAL


@pytest.mark.parametrize("name", named(in_the_hand=False))
def test_a_large_effect_is_named(name):
    """Name the effect, on its joint where it has one, with the truth near its interval."""
    kind = catalogue()[name]
    found, joint = diagnose(log(name, FREE), nominal=nominal(kind)), joint_of(kind)
    assert found.verdict == (name,)
    assert found.joints == ((joint,) if joint else found.joints)


@pytest.mark.parametrize("name", named(in_the_hand=True))
def test_a_large_effect_in_the_hand_is_named(name):
    """Name the effect and nothing else, with the truth within half of it."""
    kind = catalogue()[name]
    plan = PULLED if kind.slips else DEEP if kind.spec_fields()[0] in DEPTHS else HELD
    (one,) = in_hand(log(name, plan), IDEAL, catalogue(), on_mujoco).causes
    assert one.effect == name
    assert one.sizes[0] == pytest.approx(large(catalogue()[name]).magnitude, rel=0.5)
