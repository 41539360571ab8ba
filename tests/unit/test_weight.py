"""Weight that is carried beside the drives: in engines, in replays, and as a cause."""

from dataclasses import replace

import numpy as np
import pytest
from arms import Real, log_of

from backends import trx
from backends.catalogue import catalogue
from backends.effect import with_effects
from backends.sticks import STICKS
from backends.weight import WeightBank
from diagnosis.replay.dynamics import dynamics
from diagnosis.walk import diagnose

KINDS = catalogue()


def test_what_engines_carry_is_what_replays_leave_out():
    """Carry link by link, in worlds that differ, what the rigid-body model of a replay lacks."""
    tilted = KINDS["gravity-tilt"](magnitude=0.7).on_spec(trx.spec(STICKS["reference"]))
    own = [("J4", 0.6), ("J0", -1.0)], [("J3", 0.5), (None, 0.2)]
    worlds = [
        with_effects(tilted, [KINDS["gravity-compensation"](magnitude=m, joint=j) for j, m in some])
        for some in own
    ]
    angle = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 6))
    bank = WeightBank([tilted, *worlds])
    torque = bank.torque_nm(np.concatenate([angle[:1], angle]))
    assert bank.acts and not WeightBank([tilted]).acts
    assert not torque[0].any()
    for n, world in enumerate(worlds):
        q = angle[n : n + 1]
        left = [dynamics(spec, q, 0.0 * q)[1][0] for spec in (tilted, world)]
        assert torque[1 + n] == pytest.approx(left[0] - left[1], abs=1e-15)


@pytest.mark.parametrize(("said", "share"), [(1.0, -100.0), (0.0, 60.0)])
def test_a_compensation_that_is_not_as_said_is_named(said, share):
    """Name one that is missing, and one that nobody said, with its share, on all joints."""
    log = log_of(Real(joints=2, carried=said + share / 100.0))
    mechanism = log.meta.mechanism.model_copy(update={"gravity_compensation": said})
    log = replace(log, meta=log.meta.model_copy(update={"mechanism": mechanism}))
    found = diagnose(log)
    assert found.verdict == ("gravity-compensation",) and found.joints == ("J0", "J1")
    assert found.magnitudes[0].value == pytest.approx(share, abs=8.0)
