"""Excitation: inside the ranges, every joint moved, joints distinguished, the same for a seed."""

import numpy as np
import pytest

from backends import trx
from diagnosis.recording.excitation import (
    FREE,
    GRASP_S,
    GRIP_S,
    LATE_S,
    OPEN_LOOP,
    PULL_N,
    PULL_N_S,
    PUSH_SHARES,
    SINE_S,
    Joints,
    hand_joints,
)

FADE_S = 1.0
"""Both fades of a sum of sines together: what is left of its orthogonality [s]."""


def some_joints(count: int, seed: int) -> Joints:
    """Joints of random ranges about random centres."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-3, 0, count)
    high = low + rng.uniform(0.1, 4, count)
    return Joints(
        names=tuple(f"j{k}" for k in range(count)),
        center_rad=low + rng.uniform(0.1, 0.9, count) * (high - low),
        range_rad=np.stack([low, high], axis=1),
        limit_nm=rng.uniform(0.1, 30, count),
    )


@pytest.fixture(params=[1, 2, 6, 13])
def joints(request: pytest.FixtureRequest) -> Joints:
    """Few and many joints."""
    return some_joints(request.param, seed=request.param)


@pytest.mark.parametrize("rate_hz", [20.0, 200.0, 1000.0])
@pytest.mark.parametrize("protocol", [name for name in OPEN_LOOP if name != "pull"])
def test_targets_stay_inside_and_move_every_joint(joints, protocol, rate_hz):
    """Command nothing out of range, move every joint, begin and end in the centre."""
    made = OPEN_LOOP[protocol](joints, rate_hz, seed=1)
    low, high = joints.range_rad.T
    assert made.protocol == protocol
    assert made.target_rad.shape == made.push_nm.shape == (len(made.t_s), len(joints.names))
    assert ((low <= made.target_rad) & (made.target_rad <= high)).all()
    assert (np.ptp(made.target_rad, axis=0) > 0).all()
    assert np.abs(made.target_rad[[0, -1]] - joints.center_rad).max() < 1e-12
    assert np.allclose(np.diff(made.t_s), 1 / rate_hz)


def test_a_hand_moves_about_the_middle_of_its_ranges():
    """Take names, ranges and limits from the hand."""
    joints = hand_joints(trx.HAND)
    assert joints.names == trx.HAND.joint_names
    assert np.allclose(joints.room_rad, np.ptp(joints.range_rad, axis=1) / 2)
    assert joints.limit_nm.tolist() == [1.2, 0.6] * 3


@pytest.mark.parametrize("protocol", OPEN_LOOP)
def test_a_seed_decides_everything(protocol):
    """Repeat with the seed, differ with another."""
    joints = some_joints(4, seed=0)
    one, again, other = (OPEN_LOOP[protocol](joints, 200.0, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.target_rad, again.target_rad)
    assert np.array_equal(one.push_nm, again.push_nm)
    assert np.array_equal(one.pull_n, again.pull_n)
    kept = [np.array_equal(getattr(one, k), getattr(other, k)) for k in ("target_rad", "pull_n")]
    assert not all(kept)


def test_a_pull_holds_still_first():
    """Hold every joint, and pull no stick before it is held; then pull harder and harder."""
    joints = hand_joints(trx.HAND)
    made = OPEN_LOOP["pull"](joints, 200.0, 3)
    assert (made.target_rad == joints.center_rad).all() and not made.push_nm.any()
    pulled = made.pull_n > 0
    assert made.t_s[pulled][0] >= GRIP_S and pulled[-1]
    assert np.allclose(np.diff(made.pull_n[pulled]), PULL_N_S / 200.0)
    assert made.pull_n[-1] > 0.99 * PULL_N - PULL_N_S * LATE_S


def test_joints_step_one_after_the_other():
    """Let no two of six joints step at once, and each step to every height both ways."""
    made = FREE["steps"](hand_joints(trx.HAND), 200.0, 0)
    moves = np.diff(made.target_rad, axis=0) != 0
    assert moves.sum(axis=1).max() == 1
    assert (moves.sum(axis=0) == 20).all()


def test_joints_reverse_one_after_the_other():
    """Let no two of six joints turn at once, and each go on at constant speed in between."""
    made = FREE["triangle"](hand_joints(trx.HAND), 1000.0, 0)
    speed = np.diff(made.target_rad, axis=0)
    turns = speed[:-1] * speed[1:] < 0
    assert turns.sum(axis=1).max() == 1
    assert (turns.sum(axis=0) >= 2).all()
    paces = [np.unique(np.abs(column[np.abs(column) > 1e-12]).round(9)) for column in speed.T]
    assert all(np.ptp(p[p > 0.99 * p.max()]) < 1e-8 for p in paces)


@pytest.mark.parametrize(("protocol", "length_s"), [("multisine", SINE_S), ("grasp", GRASP_S)])
def test_sines_of_joints_are_orthogonal(protocol, length_s):
    """Share no frequency, so that only the fades at both ends correlate two joints."""
    moved = OPEN_LOOP[protocol](hand_joints(trx.HAND), 200.0, 0).target_rad
    correlation = np.corrcoef(moved.T) - np.eye(6)
    assert np.abs(correlation).max() < FADE_S / length_s


def test_slow_logs_get_no_fast_sines():
    """Leave out what a slow log would alias."""
    joints = some_joints(2, seed=0)
    spectra = []
    for rate_hz in (20.0, 200.0):
        moved = FREE["multisine"](joints, rate_hz, 0).target_rad[:, 0]
        power = np.abs(np.fft.rfft(moved - moved.mean())) ** 2
        hz = np.fft.rfftfreq(len(moved), 1 / rate_hz)
        spectra.append(power[hz > 4].sum() / power.sum())
    assert spectra[0] < 0.01 * spectra[1]


def test_pushes_act_on_held_joints_both_ways():
    """Push every joint with every share of its limit, up and down, while its target rests."""
    joints = hand_joints(trx.HAND)
    made = FREE["push"](joints, 200.0, 0)
    for j, limit in enumerate(joints.limit_nm):
        load, target = made.push_nm[:, j], made.target_rad[:, j]
        pushed = np.flatnonzero(load)
        assert (np.diff(target)[pushed[pushed < len(target) - 1]] == 0).all()
        for share in PUSH_SHARES:
            assert np.isclose(load, share * limit).any() and np.isclose(load, -share * limit).any()
        assert np.abs(load).max() == pytest.approx(max(PUSH_SHARES) * limit)
    assert all(not FREE[name](joints).push_nm.any() for name in ("steps", "triangle", "multisine"))


def test_one_joint_alone():
    """Hold and leave alone all joints but one."""
    made = FREE["push"](some_joints(3, seed=0), 200.0, 0)
    alone = made.alone(1)
    assert np.array_equal(alone.target_rad[:, 1], made.target_rad[:, 1])
    assert np.array_equal(alone.push_nm[:, 1], made.push_nm[:, 1])
    others = [0, 2]
    assert (alone.target_rad[:, others] == made.target_rad[0, others]).all()
    assert not alone.push_nm[:, others].any()
