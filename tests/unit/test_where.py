"""Where a gap lies: by joint, channel, protocol and phase."""

import numpy as np
import pytest
from arms import Real, limbs_of, log_of

from diagnosis.where import Place, _interval, largest, locate, phases


@pytest.fixture(scope="module")
def places():
    """The gap of an arm whose second joint has a weak drive."""
    limbs, _ = limbs_of(log_of(Real(joints=2, kp={1: 0.6})))
    return locate([one.nominal for one in limbs])


def test_the_largest_part_is_on_the_joint_at_fault(places):
    """Put the largest part first, on the joint that differs; shares sum to one."""
    assert places[0].joint == "J1"
    assert [p.share for p in places] == sorted((p.share for p in places), reverse=True)
    assert sum(p.share for p in places) == pytest.approx(1.0)
    for place in places:
        low, high = place.share_interval
        assert low <= high and place.rms >= 0.0 and place.samples > 0


def test_phases_of_a_known_motion():
    """Tell a hold, a ramp, a reversal and a push from the motion itself."""
    time_s = np.arange(0.0, 6.0, 0.01)
    angle = np.interp(time_s, [0, 1, 3, 5, 6], [0.0, 0.0, 1.0, 0.0, 0.0])[:, None]
    pushed = np.zeros((len(time_s), 1), dtype=bool)
    pushed[-20:] = True
    found = phases(time_s, angle, pushed)[:, 0]
    for at_s, phase in ((0.5, "hold"), (2.0, "constant speed"), (3.0, "reversal")):
        assert found[round(at_s / 0.01)] == phase
    assert set(found[-20:]) == {"external load"}


def place(joint: str, protocol: str, phase: str, share: float) -> Place:
    there = {"joint": joint, "channel": "position", "protocol": protocol, "phase": phase}
    return Place(**there, share=share, share_interval=(0.0, 1.0), rms=1.0, noise=1.0, samples=9)


def test_the_largest_part_is_said_over_all_protocols():
    """Name the phase that holds most of the gap of a limb's joints, summed over protocols."""
    places = [
        place("other", "steps", "hold", 0.4),
        place("elbow", "steps", "acceleration", 0.24),
        place("elbow", "steps", "reversal", 0.2),
        place("elbow", "triangle", "reversal", 0.16),
    ]
    said = largest(places, ["shoulder", "elbow"])
    assert said == "The largest part of the gap, 60 %, lies at reversals of elbow."


def test_shares_of_no_gap_are_numbers():
    """Give a share of 0 where resampled seconds hold no gap: much of a log may be in order."""
    low, high = _interval(np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 1.0]]), np.random.default_rng(0))
    assert (low == 0).all() and high == pytest.approx([0.75, 0.25])
