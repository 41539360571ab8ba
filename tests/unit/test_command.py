"""The way of a target to the drive against closed forms: delay, rate limit, lost packets."""

import numpy as np
import pytest

from backends import sticks, trx
from backends.command import CommandBank, rounded
from backends.spec import Spec
from backends.state import Array
from benchmark.settings.effects import parse_effects

IDEAL = trx.spec(sticks.STICKS["reference"])
DT_S, SUBSTEPS = IDEAL.timing.drive_s, IDEAL.timing.substeps
J3 = IDEAL.hand.joint_names.index("J3")


def world(text: str) -> Spec:
    """The ideal hand with effects."""
    spec = IDEAL
    for effect in parse_effects(text, spec.hand):
        spec = effect.on_spec(spec)
    return spec


def play(text: str, policy_rad: Array, seed: int = 0) -> Array:
    """What reaches the drives, (ticks, J), when the policy says `policy_rad`, one per period."""
    return follow(CommandBank([world(text)]), policy_rad, seed)


def follow(bank: CommandBank, policy_rad: Array, seed: int = 0) -> Array:
    """As `play`, in a bank of one world."""
    ticks = len(policy_rad) * SUBSTEPS
    path = []
    for tick in range(ticks):
        target = np.full((1, 6), policy_rad[tick // SUBSTEPS])
        path.append(bank.step(target, np.array([tick]), np.array([seed]))[0].copy())
    return np.array(path)


def held(policy_rad: Array) -> Array:
    """The policy's targets at every tick."""
    return np.repeat(policy_rad, SUBSTEPS)


RESTLESS = np.random.default_rng(0).uniform(-0.5, 0.5, 12)


def test_ideal_path_passes_the_target_itself() -> None:
    """Return the very target, so that an ideal world pays nothing."""
    bank, target = CommandBank([IDEAL]), np.zeros((1, 6))
    assert not bank.acts
    assert bank.step(target, np.zeros(1, dtype=int), np.zeros(1, dtype=int)) is target


@pytest.mark.parametrize("ticks", [1, 7, 20, 33, 200])
def test_delay_is_an_exact_shift(ticks: int) -> None:
    """Pass each target so many ticks late and unchanged; before that, the first one."""
    late = play(f"command-delay={ticks}ms", RESTLESS)
    now = held(RESTLESS)
    expected = np.concatenate([np.full(ticks, now[0]), now])[: len(now)]
    assert np.array_equal(late, np.tile(expected[:, None], (1, 6)))


def test_delay_between_ticks_is_linear() -> None:
    """Pass 0.6 of the target two ticks ago and 0.4 of the one before at a delay of 2.4 ms."""
    late = play("command-delay=2.4ms", RESTLESS)[:, 0]
    now = np.concatenate([np.full(3, RESTLESS[0]), held(RESTLESS)])
    assert late == pytest.approx(0.6 * now[1:-2] + 0.4 * now[:-3], abs=1e-12)


def test_steps_are_the_nearest_ones() -> None:
    """Pass multiples of the step within half of it, with the error of a uniform distribution."""
    policy, step = np.random.default_rng(1).uniform(-1, 1, 4000), np.radians(0.5)
    path = play("command-resolution=0.5deg", policy)
    assert np.array_equal(path, np.tile(held(path[::SUBSTEPS, 0])[:, None], (1, 6)))
    sent = path[::SUBSTEPS, 0]
    assert sent == pytest.approx(step * np.round(policy / step), abs=1e-12)
    error = sent - policy
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    # Var = step^2 / 12; the sample variance of a uniform one has a relative spread sqrt(0.8 / n).
    assert error.var() == pytest.approx(step**2 / 12, rel=4 * np.sqrt(0.8 / error.size))
    assert np.array_equal(rounded(policy[:, None], np.array([step]))[:, 0], sent)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rate_limit_is_the_slope_of_a_step(sign: float) -> None:
    """Move 1 / slowness per second until the target is reached, exactly and without overshoot."""
    step = sign * np.array([0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    path = play("command-rate-limit=0.2s/rad", step)[:, 0]
    moving = np.arange(1, len(path) - SUBSTEPS + 1) * DT_S / 0.2
    assert path[:SUBSTEPS] == pytest.approx(0.0)
    assert path[SUBSTEPS:] == pytest.approx(sign * np.minimum(moving, 0.5), abs=1e-12)
    assert path[-1] == sign * 0.5


def test_slow_targets_are_not_limited() -> None:
    """Pass targets whose steps the limit allows within one tick."""
    ramp = np.linspace(0.0, 0.05, 12)
    slowness = DT_S / (1.01 * np.diff(ramp).max())
    path = play(f"command-rate-limit={slowness}s/rad", ramp)
    assert np.array_equal(path[:, 0], held(ramp))


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8])
def test_share_of_lost_packets(share: float) -> None:
    """Lose the share asked for, within four standard deviations of the binomial distribution."""
    policy = np.arange(4000.0)
    kept = play(f"command-dropout={share:.0%}", policy)[::SUBSTEPS, 0]
    lost = kept[1:] != policy[1:]  # the first packet of an episode is never lost
    n = len(lost)
    assert abs(lost.mean() - share) < 4 * np.sqrt(share * (1 - share) / n)
    # Losses of neighbours are independent: as many pairs as chance gives.
    pairs = (lost[1:] & lost[:-1]).mean()
    assert abs(pairs - share**2) < 4 * np.sqrt(share**2 * (1 + 2 * share) / n)


def arrivals(path: Array) -> Array:
    """The tick of its period at which each target but the first arrives; -1 where it never does."""
    periods = path[SUBSTEPS:, 0].reshape(-1, SUBSTEPS)
    new = periods == np.arange(1.0, len(periods) + 1)[:, None]
    return np.where(new.any(axis=1), new.argmax(axis=1), -1)


def test_jitter_is_uniform() -> None:
    """Pass each target once, in all joints alike, at a tick that is uniform within the jitter."""
    path = play("control-jitter=8ms", np.arange(4000.0))
    assert (path == path[:, :1]).all() and (np.diff(path[:, 0]) >= 0).all()
    late = arrivals(path)
    n = len(late)
    counts = np.bincount(late, minlength=8)
    assert len(counts) == 8
    # A count is binomial with a share of an eighth.
    assert np.abs(counts - n / 8).max() < 4 * np.sqrt(n * 7 / 64)
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 4 / np.sqrt(n)


def test_jitter_beyond_a_period_misses_deadlines() -> None:
    """Never pass the half of the targets that the next one overtakes, at twice the period."""
    late = arrivals(play("control-jitter=40ms", np.arange(4000.0)))
    assert abs((late < 0).mean() - 0.5) < 4 * np.sqrt(0.25 / len(late))
    assert late.max() < SUBSTEPS


def test_lost_packet_keeps_the_last_one() -> None:
    """Hold, for the whole period and in all joints alike, the last target that arrived."""
    policy = np.arange(200.0)
    path = play("command-dropout=40%", policy)
    assert (path == path[:, :1]).all()
    periods = path[:, 0].reshape(-1, SUBSTEPS)
    assert (periods == periods[:, :1]).all()
    kept = periods[:, 0]
    arrived = kept == policy
    last = np.maximum.accumulate(np.where(arrived, np.arange(200), 0))
    assert np.array_equal(kept, policy[last])
    assert 0 < arrived.sum() < 200


def test_larger_share_loses_the_same_packets_and_more() -> None:
    """Lose at 60 % all that is lost at 30 %, so that more is more in every run."""
    policy = np.arange(500.0)
    some, more = (play(f"command-dropout={s}%", policy)[::SUBSTEPS, 0] != policy for s in (30, 60))
    assert (more | ~some).all()
    assert more.sum() > some.sum()


def test_seeds_decide_what_is_lost() -> None:
    """Lose the same packets for one seed and others for another."""
    policy = np.arange(300.0)
    a, b, c = (play("command-dropout=50%", policy, seed) for seed in (3, 3, 4))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_named_joint_alone_is_late() -> None:
    """Delay the target of J3 and pass the others as they are."""
    path = play("command-delay=20ms@J3", RESTLESS)
    others = np.delete(path, J3, axis=1)
    assert np.array_equal(others, np.tile(held(RESTLESS)[:, None], (1, 5)))
    assert np.array_equal(path[SUBSTEPS:, J3], held(RESTLESS)[:-SUBSTEPS])


def test_targets_are_rounded_then_lost_then_late_then_limited() -> None:
    """Give with all four what the limit makes of the delay of the losses of rounded targets."""
    text = "command-dropout=40%,command-delay=9ms,command-rate-limit=0.1s/rad"
    text += ",command-resolution=2deg"
    stepped = rounded(RESTLESS, np.array(np.radians(2)))
    lost = play("command-dropout=40%", stepped)[:, 0]
    late = np.concatenate([np.full(9, lost[0]), lost])[: len(lost)]
    expected = [late[0]]
    for wanted in late[1:]:
        most = DT_S / 0.1
        expected.append(expected[-1] + min(max(wanted - expected[-1], -most), most))
    assert play(text, RESTLESS)[:, 0] == pytest.approx(expected, abs=1e-12)


def test_new_episode_forgets_the_old_one() -> None:
    """Repeat a fresh path's run in one that was used before."""
    text = "command-dropout=40%,command-delay=30ms,command-rate-limit=0.1s/rad,control-jitter=5ms"
    used = CommandBank([world(text)])
    follow(used, 10 + RESTLESS, seed=5)
    assert np.array_equal(follow(used, RESTLESS), play(text, RESTLESS))


def test_worlds_have_their_own_paths() -> None:
    """Give each of several worlds, at ages of their own, what it gives alone."""
    texts = ("none", "command-delay=50ms", "command-dropout=50%")
    together = CommandBank([world(t) for t in texts])
    alone = [play(t, RESTLESS, seed=n) for n, t in enumerate(texts)]
    head_start = np.array([0, 40, 20])
    for now in range(-40, 160):
        tick = np.maximum(now + head_start, 0)
        target = np.repeat(RESTLESS[tick // SUBSTEPS][:, None], 6, axis=1)
        out = together.step(target, tick, np.arange(3))
        started = now + head_start >= 0
        for n in np.flatnonzero(started):
            assert np.array_equal(out[n], alone[n][tick[n]])
