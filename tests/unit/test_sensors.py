"""Sensors by themselves: noise and steps are found where they are, beside a verdict on the arm."""

import arms
import numpy as np
import pytest
from arms import Real, log_of

from backends.catalogue import catalogue
from diagnosis.answer import Diagnosis
from diagnosis.evidence.evidence import quantisation_step
from diagnosis.logs.log import Log, make_log
from diagnosis.walk import diagnose

NOISE_RAD, STEP_RAD = 2e-3, np.radians(0.3)


def noisy(log: Log) -> Log:
    """The log with noise on the position of its last joint."""
    samples, name = log.samples.copy(), f"position_rad.{log.joints[-1]}"
    samples[name] += NOISE_RAD * np.random.default_rng(1).standard_normal(len(samples))
    return make_log(log.meta, samples, log.mjcf_xml)


def coarse(log: Log) -> Log:
    """The log with positions in steps."""
    samples = log.samples.copy()
    for joint in log.joints:
        read = samples[f"position_rad.{joint}"]
        samples[f"position_rad.{joint}"] = STEP_RAD * np.round(read / STEP_RAD)
    return make_log(log.meta, samples, log.mjcf_xml)


def without(*names: str) -> dict:
    return {name: kind for name, kind in catalogue().items() if name not in names}


def sensors(result: Diagnosis) -> list[tuple[str, str | None]]:
    return [(one.effect, one.joint) for limb in result.limbs for one in limb.sensors]


def test_noise_of_one_joint():
    """Name noise on the joint that has it alone, with its size, and nothing of the arm."""
    result = diagnose(noisy(log_of(Real(joints=2))))
    assert sensors(result) == [("encoder-noise", "J1")]
    (one,) = result.limbs[0].sensors
    assert one.value == pytest.approx(1e3 * NOISE_RAD, rel=0.1)
    assert result.limbs[0].verdict == ("none",)


def test_noise_stands_beside_a_fault():
    """Name a fault and the noise; the noise lends the verdict no share and no probability."""
    loud, plain = (diagnose(log) for log in (noisy(log_of(FAULTY)), log_of(FAULTY)))
    assert sensors(loud) == [("encoder-noise", "J0")] and sensors(plain) == []
    assert loud.limbs[0].verdict == plain.limbs[0].verdict == ("kp-scale",)
    assert loud.limbs[0].sensors[0].share == 0.0


FAULTY = Real(kp={0: 0.6})


def test_noise_that_no_effect_may_be_is_unknown():
    """Say unknown where readings are noisy and the catalogue has no name for it."""
    result = diagnose(noisy(log_of(Real())), catalogue=without("encoder-noise"))
    assert sensors(result) == [("unknown", "J0")] and result.verdict == ("unknown",)


def test_coarse_encoders_are_named():
    """Name the steps of encoders, and no noise beside those that they make."""
    result = diagnose(coarse(log_of(Real(noise_rad=1e-5))))
    assert result.verdict == ("encoder-resolution",)
    assert result.limbs[0].sensors[0].value == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize("step", [np.radians(0.088), np.radians(0.29), np.radians(1.1)])
def test_coarse_targets_are_named(step):
    """Name the steps of targets by themselves, to a hundredth, and no lost packet beside them."""
    result = diagnose(log_of(Real(step_rad=step, noise_rad=1e-5)))
    assert result.verdict == ("command-resolution",)
    assert result.limbs[0].sensors[0].value == pytest.approx(np.degrees(step), rel=0.01)


def test_coarse_targets_stand_beside_a_fault():
    """Name a weak drive and the steps of its targets, and say unknown of steps without a name."""
    log = log_of(Real(kp={0: 0.6}, step_rad=0.02))
    assert set(diagnose(log).verdict) == {"kp-scale", "command-resolution"}
    assert diagnose(log, catalogue=without("command-resolution")).verdict == ("unknown",)


def test_an_error_between_few_targets_is_no_step_of_them(monkeypatch):
    """Take no cubic spring for rounded targets where these are so few that some step fits."""
    monkeypatch.setattr(arms, "PROTOCOLS", ("steps",))
    assert sensors(diagnose(log_of(Real(spring_nm_rad3=100.0)))) == []


@pytest.mark.parametrize("offset", [0.0, 0.4321])
@pytest.mark.parametrize("step", [2e-5, 1.5e-3, 0.05])
def test_a_step_is_found_at_any_offset(step, offset):
    """Measure the step of rounded readings."""
    angle = np.sin(np.linspace(0, 20, 4000)) * np.clip(8 * step, 0.01, 0.3)
    assert quantisation_step(offset + step * np.round(angle / step)) == pytest.approx(
        step, rel=1e-3
    )


def test_a_step_is_found_through_few_digits():
    """Measure the step of an encoder of 14 bits over a wide range, written to 1e-5 rad."""
    step, rng = 2 * np.pi / 2**14, np.random.default_rng(0)
    angle = np.sin(np.linspace(0, 20, 1500)) + 2e-5 * rng.normal(size=1500)
    written = np.round(step * np.round(angle / step), 5)
    assert quantisation_step(written) == pytest.approx(step, rel=1e-3)


def test_smooth_readings_have_no_step():
    """Find no step in a smooth motion, in noise, or where nothing moves."""
    rng = np.random.default_rng(0)
    smooth = np.sin(np.linspace(0, 20, 4000))
    for readings in (smooth, rng.normal(size=4000), np.zeros(4000), np.repeat([0.0, 0.1], 2000)):
        assert quantisation_step(readings) == 0.0
