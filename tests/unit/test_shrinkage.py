"""How far a gap shrinks on seconds that a fit has not seen."""

import numpy as np
import pytest
from arms import Real, limbs_of, log_of

from diagnosis.evidence.evidence import by_second
from diagnosis.shrinkage import gaps_and_shares, held_out

SECONDS = 400


def limb(*gaps: float) -> np.ndarray:
    """Root mean squares of one joint that scatter around gaps, (1, SECONDS) each."""
    rng = np.random.default_rng(0)
    return tuple(gap * rng.uniform(0.9, 1.1, (1, SECONDS)) for gap in gaps)


def test_shrinkage_is_of_the_excess_over_the_floor():
    """Give 1 where the gap falls to the noise, a half where half of the excess is left."""
    gaps, gone, gone_nominal = gaps_and_shares([limb(11.0, np.sqrt(61.0), 1.0)])
    assert gone.value == pytest.approx(1.0, abs=0.01)
    assert gone_nominal.value == pytest.approx(0.5, abs=0.02)
    assert gaps.before.value == pytest.approx(11.0, rel=0.02)
    low, high = gaps.before.interval
    assert low < gaps.before.value < high and high - low < 0.2


def test_no_gap_shrinks_by_nothing():
    """Stay finite where the nominal world leaves the noise and no more."""
    _, gone, gone_nominal = gaps_and_shares([limb(0.9, 0.9, 0.9)])
    assert np.isfinite([gone.value, *gone.interval, gone_nominal.value]).all()


def test_seconds_without_readings_do_not_count():
    """Take means over the seconds that a joint has."""
    values = np.array([[2.0, np.nan, 2.0]])
    gaps, _, _ = gaps_and_shares([(values, values, values)])
    assert gaps.before.value == 2.0


def test_held_out_seconds_are_a_little_worse_than_seen_ones():
    """Leave more on seconds that a fit has not seen, but not much on a log of one motion."""
    (one,), _ = limbs_of(log_of(Real(kp={0: 0.6})))
    seen, unseen = (
        by_second(one.evidence, left).mean()
        for left in (one.found.chosen.residual, held_out(one.fitter, one.found.chosen))
    )
    assert seen < unseen < 1.5 * seen


def test_what_a_fit_did_not_move_is_held():
    """Take a fit in which an effect on another joint stays where it was."""
    (one,), _ = limbs_of(log_of(Real(joints=2, kp={0: 0.6})))
    nominal = one.found.nominal
    first, other = (
        next(k for k, p in enumerate(one.fitter.parameters) if p.joint == j and p.least < p.most)
        for j in (0, 1)
    )
    moving = [k for k, p in enumerate(one.fitter.parameters) if p.joint in (0, None)]
    fit = one.fitter.fit((first, other), {**nominal.u, other: 0.01}, moving)
    left = held_out(one.fitter, fit)
    assert other not in fit.slopes and np.isfinite(left).all() and len(left) == len(fit.residual)
