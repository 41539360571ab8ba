"""The rules that decide, on small numbers: bounds, gaps, what is ordinary, what is worth it."""

from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.evidence.evidence import squared_gaps
from diagnosis.evidence.log_faults import absurd
from diagnosis.search.problem import lowest
from diagnosis.verdict.exact import is_likely
from diagnosis.verdict.ordinary import (
    ROBOTS,
    SIMULATORS,
    Gap,
    allowed,
    is_named,
    is_worth,
    of_healthy,
)
from diagnosis.verdict.result import verdict


def gap(*floors):
    """What is left on joints with these gaps [floors]."""
    return Gap(gap2=np.array(floors) ** 2)


def left(rms, worst=1.0):
    """A fit that leaves white residuals of this root mean square [floors]."""
    noise = np.random.default_rng(0).standard_normal(2000)
    return SimpleNamespace(residual=rms * noise, prior=0.0, worst=worst)


def test_likelihood_names_no_companion_of_a_large_cause():
    """Take a cause that wins what an integrator may be off by; beside a huge gap, only far more."""
    evidence = SimpleNamespace(parts=(slice(0, 2000),), step=np.zeros(1), size=np.ones(1))
    both, less, far_less = left(0.90), left(0.92), left(0.97)
    assert is_likely(evidence, both, [less], less)
    assert is_likely(evidence, both, [less], left(2.0))
    assert not is_likely(evidence, both, [less], left(20.0))
    assert is_likely(evidence, both, [far_less], left(20.0))


def test_the_lowest_point_keeps_its_bounds():
    """Find the bounded minimum, and release a bound that was crossed on the way alone."""
    curvature, slope = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([4.0, 1.0])
    free = lowest(curvature, slope, np.full(2, -9.0), np.full(2, 9.0))
    assert free == pytest.approx(np.linalg.solve(curvature, slope))
    held = lowest(curvature, slope, np.array([-1.0, 0.5]), np.array([1.0, 2.0]))
    assert held == pytest.approx([1.0, 0.5])


def test_one_violent_second_does_not_decide():
    """Take the mean over seconds of a second's root mean square."""
    seconds = np.repeat(np.arange(10), 100)
    evidence = SimpleNamespace(parts=(slice(0, 1000),), second=seconds, seconds=seconds)
    quiet = np.ones(1000)
    assert squared_gaps(evidence, quiet) == pytest.approx([1.0])
    quiet[:100] = 11.0
    assert squared_gaps(evidence, quiet) == pytest.approx([4.0])


def test_a_large_gap_is_named_by_size():
    """Ask for 0.7 of the gap, and for what is left to be ordinary or the law's own error."""
    assert is_named(gap(3.0), gap(20.0), ROBOTS)
    assert is_named(gap(9.0), gap(20.0), ROBOTS)
    assert not is_named(gap(9.0), gap(20.0), SIMULATORS)
    assert not is_named(gap(12.0), gap(20.0), ROBOTS)


def test_an_absurd_gap_is_not_named():
    """Leave a world that is off by factors unnamed, though a cause takes most of its gap."""
    assert not is_named(gap(60.0), gap(300.0), ROBOTS)
    assert not is_named(gap(9.0), gap(1800.0), ROBOTS)


def test_an_ordinary_gap_is_named_by_shape():
    """Ask for nearly all of an ordinary gap, and for less than a floor to be left."""
    assert is_named(gap(0.9), gap(2.5), ROBOTS)
    assert not is_named(gap(1.5), gap(2.5), ROBOTS)
    assert not is_named(gap(0.9), gap(1.2), ROBOTS)


def test_each_further_cause_takes_most_of_what_is_left():
    """Ask for 0.7 of a large rest, and for nearly all of an ordinary one."""
    assert is_worth(gap(4.0), gap(9.0), ROBOTS, gap(9.0))
    assert not is_worth(gap(6.0), gap(9.0), ROBOTS, gap(9.0))
    assert not is_worth(gap(1.5), gap(2.5), ROBOTS, gap(9.0))
    assert is_worth(gap(0.9), gap(2.5), ROBOTS, gap(9.0))


def test_joints_may_have_a_cause_each():
    """Ask for 0.7 of what is left on a joint that leaves more than a healthy robot."""
    assert is_worth(gap(2.0, 5.0), gap(6.0, 5.0), ROBOTS, gap(9.0, 5.0))
    assert not is_worth(gap(6.0, 1.0), gap(6.0, 3.0), ROBOTS, gap(9.0, 3.0))
    assert not is_worth(gap(2.0, 9.0), gap(6.0, 5.0), ROBOTS, gap(9.0, 5.0))


def test_a_small_rest_of_a_large_gap_accuses_no_further_cause():
    """Leave an ordinary rest to the laws that explained fifty floors."""
    assert not is_worth(gap(0.9), gap(2.5), ROBOTS, gap(50.0))


@pytest.mark.parametrize(("strange", "said"), [(3.6, "kp-scale"), (60.0, "unknown")])
def test_the_larger_gap_decides(strange, said):
    """Take what is named of one limb for the answer, unless another leaves a larger gap unnamed."""
    faulty = SimpleNamespace(verdict=("kp-scale",), causes=("x",), sensors=(), gap_nominal=30.0)
    other = SimpleNamespace(verdict=("unknown",), causes=(), sensors=(), gap_nominal=strange)
    assert verdict([faulty, other]) == (said,)


def test_healthy_logs_say_what_is_ordinary():
    """Take a third more than their largest gap, and never less than a noise."""
    assert of_healthy([2.0, 4.0], ROBOTS).floors == pytest.approx(5.2)
    assert of_healthy([0.3], ROBOTS).floors == pytest.approx(1.2)
    assert of_healthy([0.3], ROBOTS).source == "healthy logs"


def test_an_absurd_sample_is_one_that_returns_at_once():
    """Tell a single wild reading from a step that stays."""
    readings = np.sin(np.arange(200) / 20)
    readings[100:] += 3.0
    readings[50] += 9.0
    assert list(np.flatnonzero(absurd(readings))) == [50]


def test_lost_packets_leave_what_a_law_may_leave():
    """Allow beside an explained gap what the law that explained it may be off by."""
    assert allowed(0.0, ROBOTS) == ROBOTS.floors
    assert allowed(10.0, ROBOTS) == pytest.approx(6.5)
    assert allowed(1000.0, ROBOTS) == pytest.approx(14.0)
