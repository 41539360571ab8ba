"""Fits of a limb: what its residuals say, and fits with slopes from elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from diagnosis.evidence.evidence import evidence, root_weights
from diagnosis.models.parameters import parameters
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.packets.losses import losses
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fitter
from diagnosis.verdict.ordinary import ROBOTS


def fits(log):
    """Fits of the one limb of a log."""
    (part,) = limbs(mjcf_world(log))
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))
    return Fitter(said, parameters(catalogue(), said, 0.05, ROBOTS.everyday))


def numbered(fitter, effect, joint):
    """The number of a parameter."""
    known = enumerate(fitter.parameters)
    return next(k for k, p in known if (p.effect, p.joint) == (effect, joint))


@pytest.fixture(scope="module")
def fitter():
    """Fits of two joints, of which the first has a gain 30 % too low."""
    return fits(log_of(Real(joints=2, kp={0: 0.7})))


@pytest.fixture(scope="module")
def gain(fitter):
    """The number of the gain that is too low."""
    return numbered(fitter, "kp-scale", 0)


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
    apart = fitter.bare(fit.u, fit.freed) - fitter.shown(seen)
    assert gain in seen and len(seen) < len([size for size in fit.u.values() if size])
    assert 0.0 < np.sqrt(np.mean(apart**2)) < 0.2


def test_a_rigid_drive_gets_no_gear(fitter, gain):
    """Leave out play that only moves readings by its slope: a gear would move them otherwise."""
    play, fit = numbered(fitter, "backlash", 1), fitter.fit((gain,), {gain: -0.3})
    assert play not in fitter.seen(replace(fit, u={**fit.u, play: 3e-3}))
    named = fitter.fit((play,), {play: 3e-3})
    assert play in fitter.seen(named)


def test_play_moves_a_reading_by_no_more_than_itself():
    """Take slopes of play alone where a rigid drive rubs so that a gear would move it elsewhere."""
    log = log_of(Real(coulomb_nm={0: 30.0}))
    xml = log.mjcf_xml.replace('frictionloss="0.0"', 'frictionloss="30"')
    fitter = fits(replace(log, mjcf_xml=xml))
    play, base = numbered(fitter, "backlash", 0), fitter.bare({}, ())
    slope = fitter.slopes([play], {}, (), base)[play]
    ones = np.ones((len(fitter.evidence.measured), 3, 1))
    assert np.abs(slope).max() < 1.5 * fitter.evidence.pack(ones).max()


@pytest.mark.parametrize(
    ("real", "lost"), [(Real(lost_share=0.1), True), (Real(delay_s=0.02), False)]
)
def test_packets_are_lost_however_a_joint_moves(real, lost):
    """Late targets are far off where a joint speeds up: lost packets would not depend on that."""
    fitter = fits(log_of(real))
    plain = fitter.settled()
    found = losses(fitter, plain.u, plain.residual)
    assert found is not None and (found.chance > 0.01) == lost
