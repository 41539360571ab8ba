"""What the solver makes of every effect: the same numbers as the effect itself, within bounds."""

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from backends.effect import with_effects
from diagnosis.evidence.evidence import evidence
from diagnosis.models.parameters import bounds, magnitude, parameters
from diagnosis.models.world import World
from diagnosis.motion.columns import STIFFNESS, table
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs

ARM = log_of(Real(joints=2))
SAID = evidence(
    Limb(
        spec=(PART := limbs(mjcf_world(ARM))[0]),
        recordings=recordings(ARM, PART),
        rigid=True,
    )
)
ALL = parameters(catalogue(), SAID, uncertainty=0.05, everyday=1.0)
OWN = [k for k, p in enumerate(ALL) if p.joint is not None]
names = [f"{ALL[k].effect}@{ALL[k].joint}" for k in OWN]


@pytest.mark.parametrize("number", OWN, ids=names)
def test_a_parameter_is_the_effect_of_its_magnitude(number):
    """Change the joint's numbers as the effect of the reported magnitude does."""
    one = ALL[number]
    u = 2 * one.least
    numbers, _ = World(SAID, ALL).numbers({number: u})
    size = magnitude(one, u, SAID.limb.nominal[one.joint])
    effect = one.kind(magnitude=size, joint=SAID.joints[one.joint])
    wanted = table(with_effects(PART, [effect]), rigid=True)
    if one.kind.coordinate == "compliance":  # the arm's file has a stiff gear of its own
        soft = 1 / wanted[one.joint, STIFFNESS] - 1 / SAID.limb.nominal[one.joint, STIFFNESS]
        assert soft == pytest.approx(u * one.unit)
    else:
        assert numbers[:, one.place] == pytest.approx(wanted[:, one.place])


@pytest.mark.parametrize("number", range(len(ALL)))
def test_bounds_hold_a_parameter_and_its_sign(number):
    """Reach from a tolerance's three deviations to an effect's largest size, never below zero."""
    one = ALL[number]
    low, high = bounds(one, freed=True, reach=3.0)
    assert one.least < high == one.most
    assert low == (-one.most if one.either_sign else 0.0)
    low, high = bounds(one, freed=False, reach=3.0)
    assert low <= 0.0 <= high < one.most
    assert high == pytest.approx(3.0 * one.tolerance)


def test_every_effect_of_free_air_is_a_parameter():
    """Look for every effect that says from which size on it is one."""
    said = {name for name, kind in catalogue().items() if kind.least is not None}
    geared = {"gear-damping"}  # a rigid drive has no teeth
    assert {p.effect for p in ALL} == said - geared
    assert np.isfinite([p.unit for p in ALL]).all()
