"""The 90 % intervals of a diagnosis: in order, around what they are of, and around the truth."""

import pytest
from arms import Real, log_of

from diagnosis import Diagnosis, diagnose

TRUTH = {"kp-scale": -40.0, "coulomb-friction": 2.0}
"""What is wrong with the arm [%, Nm]."""


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """The diagnosis of an arm with a weak drive and dry friction."""
    return diagnose(log_of(Real(kp={0: 0.6}, coulomb_nm={0: 2.0}), seed=7))


def test_intervals_of_sizes_hold_the_truth(found):
    """Hold each size and what was hidden, between ends that are not far apart."""
    sizes = {one.effect: one for one in found.magnitudes}
    assert sizes.keys() == TRUTH.keys()
    for effect, truth in TRUTH.items():
        one = sizes[effect]
        assert one.low < one.value < one.high and one.low < truth < one.high
        assert one.high - one.low < 0.5 * abs(truth)


def test_intervals_of_gaps_and_shares_are_in_order(found):
    """Hold each gap and each share; shrink by what the gaps say."""
    gaps = found.gaps.before, found.gaps.nominal, found.gaps.after
    for one in gaps:
        assert one.interval[0] < one.value < one.interval[1]
    for one in (found.shrinkage, found.shrinkage_nominal):
        assert one.interval[0] <= one.value <= one.interval[1] <= 1.0
    assert gaps[0].interval[0] > gaps[2].interval[1]
    assert found.shrinkage_nominal.interval[1] < found.shrinkage.interval[0]
