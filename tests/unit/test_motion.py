"""Replays along a measured motion: against a closed form, MuJoCo, and bad logs."""

import numpy as np
import pytest
from arms import KP as KP_NM_RAD
from arms import LINKS, Real, log_of

from diagnosis.logs.log import make_log
from diagnosis.motion.columns import KD, KP, LIMIT
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import recordings
from diagnosis.replay.nominal import mjcf_world
from diagnosis.replay.parts import limbs


def limb_of(log):
    """The only limb of an arm's log."""
    (part,) = limbs(mjcf_world(log))
    return Limb(spec=part, recordings=recordings(log, part), rigid=True)


@pytest.mark.parametrize("joints", [1, 2, 3])
def test_replays_are_what_mujoco_does(joints):
    """Stay within 0.3 mrad of plain MuJoCo at half the step, its sensor's noise aside."""
    log = log_of(Real(joints=joints, noise_rad=1e-9))
    limb = limb_of(log)
    apart = limb.measured[:, 0] - limb.simulate(limb.nominal)[:, 0]
    assert np.sqrt(np.mean(apart**2)) < 3e-4


def test_a_pendulum_settles_where_its_weight_and_gain_balance():
    """Sag by m g l / kp at rest, to 1e-4 rad: the closed form of the first held target."""
    log = log_of(Real())
    limb = limb_of(log)
    shown = limb.simulate(limb.nominal)[:, 0, 0]
    held = limb.time_s[0] < 0.45
    angle = shown[: len(held)][held][-5:].mean()
    length, mass = LINKS
    weight = mass * 9.81 * length / 2 * np.cos(angle)
    assert angle == pytest.approx(weight / KP_NM_RAD, abs=1e-4)


def test_numbers_change_what_is_shown_to_first_order():
    """Give slopes that predict a small change of two gains to a hundredth."""
    limb = limb_of(log_of(Real()))
    base = limb.simulate(limb.nominal)

    def moved(kp, kd):
        numbers = limb.nominal.copy()
        numbers[:, KP] *= 1 + kp
        numbers[:, KD] *= 1 + kd
        return limb.simulate(numbers) - base

    both, sum_ = moved(1e-4, 1e-4), moved(1e-4, 0) + moved(0, 1e-4)
    assert np.abs(both - sum_).max() < 0.01 * np.abs(both).max()


def test_a_diverging_replay_is_nan_and_no_crash():
    """Show NaN where a gain is beyond what the step holds."""
    limb = limb_of(log_of(Real()))
    numbers = limb.nominal.copy()
    numbers[:, KP] *= 1e6
    numbers[:, LIMIT] = 1e12
    assert np.isnan(limb.simulate(numbers)).any()


def test_slow_samples_are_replayed():
    """Take 10 Hz without a crash."""
    log = log_of(Real())
    meta = log.meta.model_copy(update={"channels": {}})
    limb = limb_of(make_log(meta, log.samples.iloc[::20].copy(), log.mjcf_xml))
    assert np.isfinite(limb.simulate(limb.nominal)).all()
