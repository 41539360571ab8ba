"""The replay of limbs in closed form: as engines move them, and episodes side by side."""

import dataclasses

import numpy as np
import pytest

from backends.encoder import angles
from benchmark.parts import registry
from diagnosis.blind import motion, rigs
from diagnosis.calibration import worlds
from diagnosis.motion.recordings import Recording
from diagnosis.replay.expansion import SMALL_RAD, turned_a_little, wave
from diagnosis.replay.lanes import LANES
from diagnosis.replay.replay import Batch, Commands, replay, replays

EFFECTS = {"backlash": 0.01, "command-delay": 6.3e-3, "sensor-delay": 4.1e-3, "encoder-bias": 0.02}


def asked(rig: str, seed: int) -> Commands:
    """Steps of a rig, with samples 5 and 6 ticks apart."""
    one = motion.motion("steps", rigs.nominal(rig), np.random.default_rng(seed))
    ticks = np.cumsum(np.resize([0, 5, 6], len(one.target_rad)))
    return Commands(
        ticks=ticks, target=one.target_rad, load=one.push_nm, start=one.target_rad[0] + 0.01
    )


@pytest.mark.parametrize("rig", ["joint", "finger"])
@pytest.mark.parametrize("late", ["command-delay", "sensor-delay"])
def test_what_is_not_late_is_what_is_late_by_nothing(rig, late):
    """Move a limb in registers as tick by tick, with a delay that is next to none, bit by bit."""
    spec = rigs.nominal(rig)
    for name in ("backlash", "encoder-bias"):
        spec = registry.load("effect", name)(magnitude=EFFECTS[name]).on_spec(spec)
    delayed = registry.load("effect", late)(magnitude=1e-300).on_spec(spec)
    assert np.array_equal(replay(spec, asked(rig, 0)), replay(delayed, asked(rig, 0)))


@pytest.mark.parametrize("rig", ["joint", "finger"])
@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"command-delay": 6.3e-3},
        {"command-delay": 0.013, "command-rate-limit": 0.1, "kp-scale": -0.2},
        {"command-delay": 6.3e-3, "command-resolution": 0.02},
        {"sensor-delay": 6.3e-3, "encoder-scale": 0.1, "encoder-bias": 0.02},
        {"encoder-eccentricity": 0.03, "encoder-eccentricity-sine": -0.05, "encoder-bias": 0.02},
        {"stiction": 0.05, "coulomb-friction": 0.02, "dead-zone": 0.01},
        {"direction-friction": -0.05, "coulomb-friction": 0.02},
        {"torque-speed-limit": 0.1, "torque-limit": -0.3},
        {"cogging": 0.1, "coulomb-friction": 0.02},
        {"end-stop": 0.8, "backlash": 0.01},
        {"end-stop": -0.8},
        {"thermal-fade": 16.0, "presliding": 0.05, "cogging": 0.05},
        {"presliding": 0.1, "backlash": 0.01},
        {"self-lock": 0.5, "load-friction": 0.3, "encoder-scale": 0.1},
    ],
)
def test_closed_form_is_the_engines_motion(rig, effects):
    """Show the positions and motor angles of MuJoCo with the same drives, paths and sensors."""
    spec = rigs.nominal(rig)
    for name, size in effects.items():
        spec = registry.load("effect", name)(magnitude=size).on_spec(spec)
    spec = without_noise(spec)
    one = asked(rig, 0).first(250)
    one = dataclasses.replace(one, ticks=np.arange(len(one.target)) * 5)
    shown = replay(spec, one)
    errors = [vars(b.joint.encoder) for b in spec.hand.driven]
    names = ("bias_rad", "scale_error", "eccentricity_rad", "eccentricity_sine_rad")
    angle = angles(one.start, *(np.array([e[name] for e in errors]) for name in names))
    moved = Recording(
        protocol="steps",
        time_s=one.ticks * spec.timing.drive_s,
        command=one.target,
        push=one.load,
        measured=np.broadcast_to(angle, (len(one.ticks), 3, len(angle))),
        start=angle,
    )
    engine = registry.load("backend", "mujoco")
    (real,) = worlds.replay(lambda specs: engine(specs), [spec], [moved])
    assert np.ptp(real[0, :, 0], axis=0).min() > 0.05
    assert np.abs(shown[:2] - real[0].swapaxes(0, 1)).max() < 1e-6


def without_noise(spec):
    """A world whose sensors read without noise."""
    return spec.with_driven(
        dataclasses.replace(
            body,
            joint=dataclasses.replace(
                body.joint, encoder=dataclasses.replace(body.joint.encoder, noise_rad=0.0)
            ),
        )
        for body in spec.hand.driven
    )


@pytest.mark.parametrize("rig", ["joint", "finger"])
@pytest.mark.parametrize("effects", [{}, {"sensor-delay": 6.3e-3, "command-delay": 4.1e-3}])
def test_episodes_at_a_time_are_episodes_alone(rig, effects):
    """Replay more episodes than lanes, of unequal lengths, as each by itself, bit by bit."""
    spec = rigs.nominal(rig)
    for name, size in effects.items():
        spec = registry.load("effect", name)(magnitude=size).on_spec(spec)
    several = [asked(rig, 0), asked(rig, 1).first(200), asked(rig, 2).first(1)]
    several += [dataclasses.replace(asked(rig, 3), ticks=2 * several[0].ticks), asked(rig, 4)]
    several += [asked(rig, 5 + k).first(100 + 9 * k) for k in range(LANES)]
    for one, shown in zip(several, replays(spec, Batch.of(several)), strict=True):
        assert np.array_equal(shown, replay(spec, one))


def test_a_lone_sample_shows_a_limb_at_rest():
    """Show where a limb starts, if there is nothing but the start, late commands or not."""
    one = asked("joint", 0).first(1)
    spec = registry.load("effect", "command-delay")(magnitude=6e-3).on_spec(rigs.nominal("joint"))
    assert replay(spec, one)[0] == pytest.approx(one.start[None])


@pytest.mark.parametrize("move", [0.0, 1e-9, -0.004, SMALL_RAD])
def test_a_turn_keeps_its_digits(move):
    """Turn a cosine and a sine on as far as an angle moves, within rounding."""
    angle = 0.7
    assert turned_a_little(wave(angle), move) == pytest.approx(wave(angle + move), abs=4e-16)
