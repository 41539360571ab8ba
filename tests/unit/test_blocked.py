"""Where an end stop may stand in a joint's way, as a log shows it before any fit."""

from dataclasses import replace

import pytest
from arms import Real, log_of, mjcf

from diagnosis.motion.blocked import blocked
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs
from diagnosis.walk import diagnose

STOP_RAD = 0.25


def limb_of(log) -> Limb:
    """The one limb of an arm's log."""
    part = limbs(mjcf_world(log))[0]
    return Limb(spec=part, recordings=recordings(log, part), rigid=True)


def test_a_stop_shows_where_the_joint_falls_short():
    """See the side, how far the joint falls short, and a stop that is stiffer than the servo."""
    free, stopped = (blocked(limb_of(log_of(Real(stop_rad=s))))[0] for s in (None, STOP_RAD))
    assert free.short_rad < 2e-3
    assert stopped.side == 1.0
    reach = stopped.inside_rad + stopped.short_rad
    assert reach == pytest.approx(3.14159 - STOP_RAD, abs=0.05)
    assert stopped.stiffness_nm_rad > 3 * 120.0


@pytest.mark.parametrize("joints", [1, 2])
def test_a_stop_of_an_arm_is_named_with_its_angle(joints):
    """Name the stop of an arm in plain MuJoCo, on its joint, and say where it stands."""
    found = diagnose(log_of(Real(joints=joints, stop_rad=STOP_RAD)))
    assert (found.verdict, found.joints) == (("end-stop",), (f"J{joints - 1}",))
    (cause,) = found.magnitudes
    stands = float(cause.also.removeprefix("at ").removesuffix(" deg"))
    assert stands == pytest.approx(14.3, abs=1.0)


@pytest.mark.parametrize(("kp", "verdict"), [({}, "none"), ({1: 0.6}, "kp-scale")])
def test_a_stop_that_the_model_has_is_no_fault(kp, verdict):
    """Judge nothing where a joint stands at the end of its range, and the rest of the log."""
    log = log_of(Real(joints=2, stop_rad=STOP_RAD, kp=kp))
    found = diagnose(replace(log, mjcf_xml=mjcf(2, stop_rad=STOP_RAD)))
    assert found.verdict == (verdict,)
    assert "end of its range" in found.notes[0]
