"""Position sensors against closed forms: bias, scale, steps, noise, delay, and their side."""

import dataclasses

import numpy as np
import pytest

from backends import encoder, sticks, trx
from backends.encoder import EncoderBank
from backends.spec import Spec
from backends.state import Array
from benchmark.settings.effects import parse_effects

IDEAL = trx.spec(sticks.STICKS["reference"])
RNG = np.random.default_rng(0)
ANGLES = np.cumsum(RNG.uniform(-0.01, 0.01, (400, 6)), axis=0)
"""A walk of all joints [rad], one row per tick."""
SAMPLES = 20_000


def world(text: str) -> Spec:
    """The ideal hand with effects."""
    spec = IDEAL
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def readings(spec: Spec, angles: Array, seed: int = 0) -> Array:
    """What the sensors of a world report of `angles` (ticks, J) at every tick."""
    bank = EncoderBank([spec])
    path = []
    for tick, angle in enumerate(angles):
        now, joint, motor = np.array([tick]), angle[None], -angle[None]
        bank.note(joint, motor, now)
        path.append(bank.read(joint, motor, now, np.array([seed]))[0].copy())
    return np.array(path)


def test_ideal_sensor_reports_the_angle() -> None:
    """Report the joint's angle, to the bit, and the motor's where the sensor sits there."""
    assert np.array_equal(readings(IDEAL, ANGLES), ANGLES)
    driven = list(IDEAL.hand.driven)
    driven[2] = dataclasses.replace(
        driven[2], joint=dataclasses.replace(driven[2].joint, sensor="motor")
    )
    sides = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    assert np.array_equal(readings(IDEAL.with_driven(driven), ANGLES), sides * ANGLES)


def test_bias_and_scale() -> None:
    """Report (1 + scale) angle + bias, each on the joints that it names."""
    read = readings(world("encoder-bias=1deg@J0,encoder-scale=-3%@J1"), ANGLES)
    expected = ANGLES * np.array([1.0, 0.97, 1.0, 1.0, 1.0, 1.0])
    expected[:, 0] += np.radians(1.0)
    assert read == pytest.approx(expected, abs=1e-15)


def test_error_once_per_turn() -> None:
    """Add e cos(angle) and f sin(angle): together one wave of amplitude hypot(e, f) a turn."""
    angles = np.linspace(0, 2 * np.pi, 361)[:, None] * np.ones(6)
    error = readings(world("encoder-eccentricity=3deg,encoder-eccentricity-sine=4deg"), angles)
    error = np.degrees(error - angles)
    phase = np.arctan2(4.0, 3.0)
    assert error == pytest.approx(5 * np.cos(angles - phase), abs=1e-9)


def test_readings_tell_the_angle() -> None:
    """Invert bias, scale and what goes once per turn to the last digit, at the effects' bounds."""
    errors = np.array([0.02, -0.1, np.radians(5), np.radians(-5), 0.3])
    spec = world(
        f"encoder-bias={errors[0]}rad,encoder-scale={100 * errors[1]}%,"
        f"encoder-eccentricity={errors[2]}rad,encoder-eccentricity-sine={errors[3]}rad,"
        f"joint-zero={errors[4]}rad"
    )
    found = encoder.angles(readings(spec, 3 * ANGLES), *errors)
    assert found == pytest.approx(3 * ANGLES, abs=1e-14)


def test_a_slide_has_no_turn() -> None:
    """Leave slides alone, and refuse one that is named."""
    bodies = list(IDEAL.hand.driven)
    bodies[0] = dataclasses.replace(
        bodies[0], joint=dataclasses.replace(bodies[0].joint, slides=True)
    )
    spec = IDEAL.with_driven(bodies)
    (effect,) = parse_effects("encoder-eccentricity=1deg", IDEAL.hand)
    assert effect.joints(spec) == IDEAL.hand.joint_names[1:]
    with pytest.raises(ValueError, match="J0 slides"):
        dataclasses.replace(effect, joint="J0").on_spec(spec)


def test_steps_are_the_nearest_ones() -> None:
    """Report multiples of the step within half of it, with the error of a uniform distribution."""
    step = np.radians(0.5)
    angles = np.random.default_rng(1).uniform(-1, 1, (SAMPLES // 6, 6))
    read = readings(world("encoder-resolution=0.5deg"), angles)
    assert np.abs(read / step - np.round(read / step)).max() < 1e-9
    error = (read - angles).ravel()
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    # Var = step^2 / 12; the sample variance of a uniform one has a relative spread sqrt(0.8 / n).
    assert error.var() == pytest.approx(step**2 / 12, rel=4 * np.sqrt(0.8 / error.size))


def test_noise_is_white_and_normal() -> None:
    """Add independent normal noise: moments and correlations within four standard errors."""
    std_rad = 2e-3
    noise = readings(world("encoder-noise=2mrad"), np.zeros((SAMPLES, 6))) / std_rad
    n = noise.size
    assert abs(noise.mean()) < 4 / np.sqrt(n)
    assert noise.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / n))
    assert abs((noise**3).mean()) < 4 * np.sqrt(15 / n)
    assert (noise**4).mean() == pytest.approx(3.0, abs=4 * np.sqrt(96 / n))
    for lag in (1, 2, 20):
        assert abs((noise[lag:] * noise[:-lag]).mean()) < 4 / np.sqrt(n)
    joints = noise.T @ noise / SAMPLES
    assert np.abs(joints - np.diag(np.diag(joints))).max() < 4 / np.sqrt(SAMPLES)


def test_noise_scales_and_follows_the_seed() -> None:
    """Double with the magnitude, repeat with the seed, and change with another seed."""
    once, twice = (readings(world(f"encoder-noise={s}mrad"), 0 * ANGLES) for s in (1, 2))
    assert twice == pytest.approx(2 * once, rel=1e-12)
    assert np.array_equal(once, readings(world("encoder-noise=1mrad"), 0 * ANGLES))
    assert (once != readings(world("encoder-noise=1mrad"), 0 * ANGLES, seed=1)).all()


@pytest.mark.parametrize("ticks", [1, 7, 20, 200])
def test_delay_is_an_exact_shift(ticks: int) -> None:
    """Report each angle so many ticks late and unchanged; before that, the first one."""
    read = readings(world(f"sensor-delay={ticks}ms"), ANGLES)
    expected = np.concatenate([np.repeat(ANGLES[:1], ticks, axis=0), ANGLES])[: len(ANGLES)]
    assert np.array_equal(read, expected)


def test_delay_between_ticks_is_linear() -> None:
    """Report 0.75 of the angle one tick ago and 0.25 of the one before at 1.25 ms."""
    read = readings(world("sensor-delay=1.25ms"), ANGLES)
    assert read[2:] == pytest.approx(0.75 * ANGLES[1:-1] + 0.25 * ANGLES[:-2], abs=1e-15)


def test_steps_come_last() -> None:
    """Quantise what scale, delay, bias and noise have made of the angle."""
    text = "encoder-scale=2%,sensor-delay=5ms,encoder-bias=0.3deg,encoder-noise=1mrad"
    smooth = readings(world(text), ANGLES, seed=3)
    stepped = readings(world(f"{text},encoder-resolution=0.4deg"), ANGLES, seed=3)
    step = np.radians(0.4)
    assert stepped == pytest.approx(step * np.round(smooth / step), abs=1e-12)
    noise = readings(world("encoder-noise=1mrad"), 0 * ANGLES, seed=3)
    expected = 1.02 * ANGLES[:-5] + np.radians(0.3) + noise[5:]
    assert smooth[5:] == pytest.approx(expected, abs=1e-12)


def test_reading_twice_is_reading_once() -> None:
    """Report the same again at the same tick, as when another world is reset."""
    bank = EncoderBank([world("encoder-noise=1mrad,sensor-delay=3ms")])
    for tick in range(8):
        now, angle = np.array([tick]), ANGLES[tick : tick + 1]
        bank.note(angle, angle, now)
        first = bank.read(angle, angle, now, np.zeros(1, dtype=int)).copy()
        bank.note(angle, angle, now)
        assert np.array_equal(first, bank.read(angle, angle, now, np.zeros(1, dtype=int)))


def test_new_episode_forgets_the_old_one() -> None:
    """Report at the start of an episode its own first angle, however late the sensor is."""
    bank = EncoderBank([world("sensor-delay=50ms")])
    for start in (0.5, -0.7):
        for tick in range(30):
            angle = np.full((1, 6), start)
            bank.note(angle, angle, np.array([tick]))
            assert (
                bank.read(angle, angle, np.array([tick]), np.zeros(1, dtype=int)) == start
            ).all()
