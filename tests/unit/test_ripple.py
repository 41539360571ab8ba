"""Period and phase of a joint's cogging, as a log shows them before any fit."""

from dataclasses import replace

import pytest

from backends import trx
from backends.shard import simulate
from backends.sticks import STICKS
from benchmark.parts import registry
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.motion.ripple import ripples
from diagnosis.recording.record import Plan, record
from diagnosis.replay.parts import limbs

PERIOD_RAD, PHASE_RAD = 0.15, 1.0
PLAN = Plan(protocols=("steps", "triangle"), variants=1, channels=("command", "position"), seed=3)
HAND = trx.spec(STICKS["reference"])


@pytest.fixture(scope="module")
def limb():
    """The second finger, whose proximal joint cogs and has more gain than its model says."""
    drives = list(HAND.drives)
    drives[2] = replace(
        drives[2],
        kp_nm_rad=1.05 * drives[2].kp_nm_rad,
        cogging_nm=0.05,
        cogging_period_rad=PERIOD_RAD,
        cogging_phase_rad=PHASE_RAD,
    )
    log = record(
        lambda specs: simulate(registry.load("backend", "mujoco"), specs, 1),
        HAND.with_drives(drives),
        PLAN,
        "x",
    )
    part = limbs(HAND)[1]
    return Limb(spec=part, recordings=recordings(log, part), rigid=False)


def test_period_and_phase_are_seen_beside_a_gain_that_is_off(limb):
    """See the period to a hundredth, and the phase to a tenth of a radian."""
    period, phase = ripples(limb)[0]
    assert period == pytest.approx(PERIOD_RAD, rel=0.01)
    assert phase == pytest.approx(PHASE_RAD, abs=0.1)


def test_a_log_that_says_nothing_shows_no_period(limb):
    """Give zeros where a joint hardly moves, or for too short a time."""
    short = tuple(
        replace(
            r,
            time_s=r.time_s[:20],
            command=r.command[:20],
            push=r.push[:20],
            measured=r.measured[:20],
        )
        for r in limb.recordings[:1]
    )
    assert not ripples(replace(limb, recordings=short)).any()
