"""What the solver makes of every effect: the same numbers as the effect itself, within bounds."""

from dataclasses import replace

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from backends.effect import with_effects
from diagnosis.evidence.evidence import Evidence, evidence
from diagnosis.models.parameters import Parameter, bounds, magnitude, parameters
from diagnosis.models.world import World
from diagnosis.motion.columns import STIFFNESS, table, with_numbers
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs


@pytest.fixture(scope="module")
def said() -> Evidence:
    """What the log of an arm says of its one limb."""
    log = log_of(Real(joints=2))
    part = limbs(mjcf_world(log))[0]
    return evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))


@pytest.fixture(scope="module")
def every(said) -> tuple[Parameter, ...]:
    """The parameters of its joints."""
    return parameters(catalogue(), said, uncertainty=0.05, everyday=1.0)


def test_a_parameter_is_the_effect_of_its_magnitude(said, every):
    """Change the joint's numbers as the effect of the reported magnitude does."""
    for number, one in enumerate(every):
        if one.joint is None or one.part_of is not None:
            continue
        u = 2 * one.least
        numbers, _ = World(said, every).numbers({number: u})
        size = magnitude(one, u, said.limb.nominal[one.joint])
        effect = one.kind(magnitude=size, joint=said.joints[one.joint])
        wanted = table(with_effects(said.limb.spec, [effect]), rigid=True)
        if one.kind.coordinate == "compliance":  # the arm's file has a stiff gear of its own
            soft = 1 / wanted[one.joint, STIFFNESS] - 1 / said.limb.nominal[one.joint, STIFFNESS]
            assert soft == pytest.approx(u * one.unit), one
        else:
            assert numbers[:, one.place] == pytest.approx(wanted[:, one.place]), one


def test_slides_have_no_error_of_a_turn(said):
    """Look for what only hinges have on no slide, and for other errors of its sensor."""
    spec = said.limb.spec
    bodies = (replace(b, joint=replace(b.joint, slides=True)) for b in spec.hand.driven)
    slides = replace(said, limb=replace(said.limb, spec=spec.with_driven(bodies)))
    names = {one.effect for one in parameters(catalogue(), slides, 0.05, 1.0)}
    assert "encoder-bias" in names
    assert not names & {name for name, kind in catalogue().items() if kind.hinges_only}


@pytest.mark.parametrize("viscous", [0.6, 0.0])
def test_drives_without_kd_may_have_viscous_friction(said, viscous):
    """Measure it by what damps the joint, and look for no other gain on speeds that are not fed."""
    spec = said.limb.spec
    undamped = {
        b.joint.name: {"drive.kd_nms_rad": 0.0, "drive.viscous_nms_rad": viscous}
        for b in spec.hand.driven
    }
    bare = replace(said, limb=replace(said.limb, spec=with_numbers(spec, undamped)))
    found = parameters(catalogue(), bare, 0.05, 1.0)
    assert "kd-scale" not in {one.effect for one in found}
    sizes = [
        one.unit for one in found if one.effect == "viscous-friction" and one.joint is not None
    ]
    assert sizes and min(sizes) > 0.0
    assert np.isfinite([one.tolerance for one in found]).all()


def test_bounds_hold_a_parameter_and_its_sign(every):
    """Reach from a tolerance's three deviations to an effect's largest size, never below zero."""
    for one in every:
        low, high = bounds(one, freed=True, reach=3.0)
        assert one.least < high == one.most, one
        assert low == (-one.most if one.kind.either_sign else 0.0), one
        low, high = bounds(one, freed=False, reach=3.0)
        assert low <= 0.0 <= high < one.most, one
        assert high == pytest.approx(3.0 * one.tolerance), one


def test_every_effect_of_free_air_is_a_parameter(every):
    """Look for every effect that says from which size on it is one."""
    said = {name for name, kind in catalogue().items() if kind.least is not None}
    geared = {"gear-damping"}  # a rigid drive has no teeth
    assert {p.effect for p in every} == said - geared | {"soft-friction"}
    assert np.isfinite([p.unit for p in every]).all()
