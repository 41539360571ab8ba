"""Worlds and episodes of a limb side by side, in replays and as lost packets are decoded."""

import dataclasses

import numpy as np
import pytest

from benchmark.parts import registry
from diagnosis.blind import motion, rigs
from diagnosis.replay import limb
from diagnosis.replay.expansion import SMALL_RAD, turned, wave
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


@pytest.mark.parametrize("rig", rigs.RIGS)
def test_worlds_side_by_side_are_worlds_alone(rig):
    """Move two worlds at once, and sample by sample, as each moves by itself, bit by bit."""
    spec = rigs.nominal(rig)
    for name, size in EFFECTS.items():
        spec = registry.load("effect", name)(magnitude=size).on_spec(spec)
    one, other = asked(rig, 0), asked(rig, 1)
    numbers = limb.numbers(spec, 2)
    rings, state = limb.memory(numbers), limb.rest(one.start, numbers)
    age, alive = np.zeros(2, dtype=np.int64), np.ones(2, dtype=bool)
    shown = np.zeros((len(one.ticks), 2, 4, len(spec.drives)))
    targets = np.stack([one.target, other.target], axis=1)
    for k, ticks in enumerate(np.diff(one.ticks, prepend=one.ticks[:1])):
        held = targets[max(k - 1, 0)][None]
        now = np.array([ticks]), held, one.load[:1]
        limb.run(*now, alive, numbers, rings, state, age, shown[k : k + 1])
    for w, commands in enumerate((one, other)):
        assert np.array_equal(shown[:, w].transpose(1, 0, 2), replay(spec, commands))


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
        {"command-delay": 6.3e-3},
        {"command-rate-limit": 0.3},
        {"command-delay": 0.013, "command-rate-limit": 0.1, "backlash": 0.01},
        {"sensor-delay": 4.0e-3},
        {"sensor-delay": 6.3e-3, "encoder-scale": 0.1, "encoder-bias": 0.02},
        {"sensor-delay": 0.2, "command-delay": 6.3e-3, "backlash": 0.01},
    ],
)
def test_what_is_predicted_is_what_happens_tick_by_tick(rig, effects):
    """Move and read a limb by what is late or limited beforehand as by its path, also at rest."""
    spec, one = rigs.nominal(rig), asked(rig, 0)
    for name, size in effects.items():
        spec = registry.load("effect", name)(magnitude=size).on_spec(spec)
    one = dataclasses.replace(one, ticks=np.maximum(one.ticks - 30, 0))
    numbers, out = limb.numbers(spec), np.zeros((len(one.ticks), 1, 4, len(spec.drives)))
    state, age, alive = limb.rest(one.start, numbers), np.zeros(1, dtype=np.int64), np.ones(1, bool)
    spans, target = np.diff(one.ticks, prepend=0), np.concatenate([one.target[:1], one.target[:-1]])
    load = np.concatenate([one.load[:1], one.load[:-1]])
    rings = limb.memory(numbers)
    limb.run(spans, target[:, None], load, alive, numbers, rings, state, age, out)
    assert replay(spec, one) == pytest.approx(out[:, 0].transpose(1, 0, 2), abs=1e-9)


@pytest.mark.parametrize("rig", ["joint", "finger"])
@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"stiction": 0.05, "coulomb-friction": 0.02, "dead-zone": 0.01},
        {"backlash": 0.02, "self-lock": 0.5, "load-friction": 0.3, "encoder-scale": 0.1},
    ],
)
def test_lanes_do_what_a_limb_alone_does(rig, effects):
    """Move a limb in SIMD's lanes as by itself, bit by bit: slow, and so fast that waves jump."""
    spec = rigs.nominal(rig)
    for name, size in effects.items():
        spec = registry.load("effect", name)(magnitude=size).on_spec(spec)
    slow = asked(rig, 0)
    pushed = np.arange(len(slow.load))[:, None] > 50
    fast = dataclasses.replace(slow, load=slow.load + (5.0 if rig == "joint" else 1.3) * pushed)
    numbers, alive = limb.numbers(spec), np.ones(1, dtype=bool)
    for one in (slow, fast):
        batch, out = Batch.of([one]), np.zeros((len(one.ticks), 1, 4, len(spec.drives)))
        state, age = limb.rest(one.start, numbers), np.zeros(1, dtype=np.int64)
        now = batch.ticks, batch.target[:, None], batch.load, alive
        limb.run(*now, numbers, limb.memory(numbers), state, age, out)
        assert np.array_equal(replay(spec, one), out[:, 0].transpose(1, 0, 2))
    assert np.abs(out[:, 0, 3]).max() * spec.timing.drive_s > SMALL_RAD


@pytest.mark.parametrize("rig", rigs.RIGS)
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


@pytest.mark.parametrize("move", [0.0, 1e-9, -0.004, 0.0299, 0.0301, -2.0])
def test_a_turn_keeps_its_digits(move):
    """Turn a cosine and a sine on as far as an angle moves, small or large, within rounding."""
    angle = 0.7
    assert turned(wave(angle), angle + move, move) == pytest.approx(wave(angle + move), abs=4e-16)
