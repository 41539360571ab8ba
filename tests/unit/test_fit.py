"""Fits of a limb: what its residuals say, and fits with slopes from elsewhere."""

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from diagnosis.evidence.evidence import evidence, root_weights
from diagnosis.models.parameters import parameters
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fitter
from diagnosis.verdict.ordinary import ROBOTS


@pytest.fixture(scope="module")
def fitter():
    """Fits of two joints, of which the first has a gain 30 % too low."""
    log = log_of(Real(joints=2, kp={0: 0.7}))
    (part,) = limbs(mjcf_world(log))
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))
    return Fitter(said, parameters(catalogue(), said, 0.05, ROBOTS.everyday))


@pytest.fixture(scope="module")
def gain(fitter):
    """The number of the gain that is too low."""
    known = enumerate(fitter.parameters)
    return next(k for k, p in known if (p.effect, p.joint) == ("kp-scale", 0))


def test_residuals_below_a_floor_say_less(fitter):
    """Count noise of half a floor less than noise of a floor: the rest is the model's own error."""
    white = np.random.default_rng(0).normal(size=fitter.evidence.readings.shape)
    half, whole = (root_weights(fitter.evidence, size * white) for size in (0.5, 1.0))
    assert (half**2).sum() < 0.2 * (whole**2).sum()


def test_a_rough_fit_is_near_and_a_fit_from_there_is_right(fitter, gain):
    """Begin with slopes of the nominal numbers, then find the gain and its interval."""
    plain = fitter.fit(steps=0)
    rough = fitter.fit((gain,), {gain: -0.1}, slopes=plain.slopes, again=False)
    fit = fitter.fit((gain,), rough.u)
    assert rough.gap < 0.1 * plain.gap and fit.gap < 1.0
    assert fit.u[gain] == pytest.approx(np.log(0.7), abs=0.03)
    assert abs(fit.u[gain] - np.log(0.7)) < 2.0 * fit.sd[gain]


def test_no_model_needs_what_hardly_shows(fitter, gain):
    """Leave out tolerances that change nothing together, and no effect."""
    fit = fitter.fit((gain,), {gain: -0.3})
    seen = fitter.seen(fit)
    apart = fitter.shown(fit.u) - fitter.shown(seen)
    assert gain in seen and len(seen) < len([size for size in fit.u.values() if size])
    assert 0.0 < np.sqrt(np.mean(apart**2)) < 0.2
