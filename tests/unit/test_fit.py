"""Fits of a limb that begin from what is known of another fit."""

import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from diagnosis.evidence.evidence import evidence
from diagnosis.models.parameters import parameters
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fitter
from diagnosis.verdict.ordinary import ROBOTS


@pytest.fixture(scope="module")
def fitter():
    """Fits of two joints, of which the first has a gain 40 % too low."""
    log = log_of(Real(joints=2, kp={0: 0.6}))
    (part,) = limbs(mjcf_world(log))
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))
    return Fitter(said, parameters(catalogue(), said, 0.05, ROBOTS.everyday))


def number(fitter, effect, joint):
    """The number of an effect on a joint."""
    known = enumerate(fitter.parameters)
    return next(k for k, p in known if (p.effect, p.joint) == (effect, joint))


def test_slopes_are_taken_again_where_they_change(fitter):
    """Take those of the joint whose gain moves, keep those of the other, and fit as well."""
    gain = number(fitter, "kp-scale", 0)
    damping = [number(fitter, "kd-scale", joint) for joint in (0, 1)]
    plain = fitter.fit(steps=0)
    fresh, known = (fitter.fit((gain,), {gain: -0.1}, slopes=s) for s in (None, plain.slopes))
    is_kept = [known.slopes[k] is plain.slopes[k] for k in damping]
    assert is_kept == [False, True]
    assert known.u[gain] == pytest.approx(fresh.u[gain], abs=0.02)
    assert known.gap < 1.0 and fresh.gap < 1.0


def test_a_fit_that_is_done_takes_no_slope_again(fitter):
    """Go on from where a fit ended with its slopes."""
    gain = number(fitter, "kp-scale", 0)
    first = fitter.fit((gain,), {gain: -0.4})
    more = fitter.fit((gain,), first.u, slopes=first.slopes)
    held = [k for k in first.slopes if k != gain]
    assert held and all(more.slopes[k] is first.slopes[k] for k in held)
    assert more.excess <= first.excess + 1e-6
