"""The search of causes on one joint's log: smaller sets, and from a part of a log to all of it."""

from dataclasses import replace

import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from diagnosis.evidence.evidence import evidence
from diagnosis.models.parameters import parameters
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.search.fit import Fit, Fitter, costs
from diagnosis.search.search import Found, Search, ranked
from diagnosis.search.whole import on_whole
from diagnosis.verdict.ordinary import ROBOTS


@pytest.fixture(scope="module")
def fitter():
    """Fits of an arm whose gain is 40 % too low."""
    log = log_of(Real(kp={0: 0.6}))
    (part,) = limbs(mjcf_world(log))
    said = evidence(Limb(spec=part, recordings=recordings(log, part), rigid=True))
    known = parameters(catalogue(), said, 0.05, ROBOTS.everyday)
    return Fitter(said, known)


def number(fitter, effect):
    """The number of an effect on the first joint."""
    return next(k for k, p in enumerate(fitter.parameters) if (p.effect, p.joint) == (effect, 0))


def test_a_smaller_set_is_fitted_from_the_larger_one(fitter):
    """Find that the gain alone does as well, though its own first fit did not get there."""
    gain, bias = number(fitter, "kp-scale"), number(fitter, "encoder-bias")
    search = Search(fitter, ROBOTS, lambda text, done: None)
    search._keep(fitter.fit((gain,), {gain: 1.0}, steps=1))
    astray = search.tried[frozenset({gain})]
    both = fitter.fit((gain, bias), {gain: -0.5})
    assert search._without(both, bias).excess < 0.1 * astray.excess


def test_of_fits_that_leave_the_same_the_likelier_is_kept(fitter):
    """Keep tolerances near their centres, unless those far off leave clearly less."""
    gain = number(fitter, "kp-scale")
    fit = fitter.fit((gain,), {gain: -0.5})
    floors = 2.0 / fit.gap
    near = replace(fit, gap2=floors**2 * fit.gap2)
    far = replace(near, gap2=0.999 * near.gap2, prior=near.prior + 20.0)
    better = replace(far, gap2=far.gap2 / 2)
    for fits, kept in (((near, far), near), ((far, near), near), ((near, better), better)):
        search = Search(fitter, ROBOTS, lambda text, done: None)
        for one in fits:
            search._keep(one)
        assert search.tried[frozenset({gain})] is kept


def test_a_set_that_diverges_explains_nothing(fitter):
    """Rank no effect whose replay diverges, such as a load of less than nothing."""
    gain, load = number(fitter, "kp-scale"), number(fitter, "payload")
    none, apart = np.zeros_like(fitter.evidence.readings), np.array([np.inf])
    wild = Fit(freed=(load,), u={load: -2.0}, residual=none, gap2=apart)
    search = Search(fitter, ROBOTS, lambda text, done: None)
    right = fitter.fit((gain,), {gain: -0.5})
    search._keep(wild)
    search._keep(right)
    assert not np.isfinite(wild.excess)
    assert [one.freed for one in search._found(right).singles] == [(gain,)]


def test_what_says_the_same_is_tied(fitter):
    """Say of damping that it may be a gain, for positions alone cannot tell them apart."""
    gain, friction = number(fitter, "kd-scale"), number(fitter, "viscous-friction")
    search = Search(fitter, ROBOTS, lambda text, done: None)
    fit = fitter.fit((gain,), {gain: 0.3})
    search._keep(fit)
    found = search._found(fit)
    assert {one.freed for one in (found.chosen, *found.tied)} == {(gain,), (friction,)}


def test_tied_sets_are_fitted_on(fitter):
    """Let no set lead because the fit of another ended early."""
    gain = number(fitter, "kd-scale")
    search = Search(fitter, ROBOTS, lambda text, done: None)
    rough = fitter.fit((gain,), {gain: 0.3}, steps=1)
    search._keep(rough)
    found = search._found(rough)
    assert found.tied
    again = next(one for one in (found.chosen, *found.tied) if one.freed == rough.freed)
    after, before = costs(fitter.evidence, (again, rough))
    assert after < before


@pytest.mark.parametrize("name", ["encoder-eccentricity", "encoder-eccentricity-sine"])
def test_of_two_laws_alike_the_plain_one_leads(fitter, name):
    """Put an offset or a scale before the wave that it is part of, and a clear wave first."""
    plain = number(fitter, catalogue()[name].narrow_as)
    alike = fitter.fit((plain,), {plain: 0.02})
    for floors in (1.0, 0.5 / alike.gap):
        alike = replace(alike, gap2=floors**2 * alike.gap2, residual=floors * alike.residual)
        wave = replace(alike, freed=(number(fitter, name),))
        better = replace(wave, gap2=alike.gap2 / 2, residual=alike.residual / np.sqrt(2.0))
        sets = ranked(fitter, [wave, alike, better])
        assert [id(one) for one in sets] == [id(one) for one in (better, alike, wave)]


def test_of_sets_that_leave_the_same_the_likelier_leads(fitter):
    """Put the set first whose tolerances are near their centres."""
    gain = number(fitter, "kp-scale")
    near = fitter.fit((gain,), {gain: -0.5})
    far = replace(near, gap2=(1.0 - 1e-5) * near.gap2, prior=near.prior + 1.0)
    assert ranked(fitter, [far, near])[0] is near


def test_the_whole_log_may_choose_otherwise_than_a_part(fitter):
    """Name what leaves least on all of a log, not what a search on its part came to."""
    gain, friction = number(fitter, "kp-scale"), number(fitter, "coulomb-friction")
    right, wrong = fitter.fit((gain,), {gain: -0.5}), fitter.fit((friction,), {friction: 0.05})
    found = Found(
        nominal=fitter.settled(), chosen=wrong, singles=(right, wrong), tied=(), is_likely=True
    )
    again = on_whole(fitter, found, ROBOTS, lambda text, done: None)
    assert again.chosen.freed == (gain,) and not again.is_likely
