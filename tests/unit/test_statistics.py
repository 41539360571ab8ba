"""The leaderboard's statistics against rliable, closed forms and simulated seeds."""

import math

import numpy as np
import pytest

from leaderboard.statistics import LEVEL, estimate, improvement, interquartile_mean, mean, resample

X = np.random.default_rng(1).random((8, 3))
Y = 0.7 * np.random.default_rng(2).random((6, 3))
"""Scores as rliable takes them: a row per run, a column per task."""
RLIABLE_DRAWS, DRAWS = 50_000, 20_000


def strata(scores: np.ndarray) -> list[np.ndarray]:
    """A stratum per task, in it a seed per run of one episode each."""
    return [task[:, None] for task in scores.T]


def share_error(share: float, draws: int, others: int) -> float:
    """Five standard errors of the difference of two shares that estimate the same one."""
    return 5 * math.sqrt(share * (1 - share) * (1 / draws + 1 / others))


@pytest.mark.parametrize(
    ("statistic", "value", "low", "high"),
    [
        (mean, 0.49043505, 0.38407373, 0.59873788),
        (interquartile_mean, 0.45575073, 0.34404376, 0.6082453),
    ],
)
def test_agrees_with_rliable(statistic, value: float, low: float, high: float) -> None:
    """Find rliable's values, and its limits at 2.5 and 97.5 % of our own draws.

    The numbers were printed by rliable 1.2.0 (arch 7.2.0, numpy 2.4.6, scipy 1.17.1, pandas 2.3.3):

        np.random.seed(0)
        both = lambda s: np.array([metrics.aggregate_mean(s), metrics.aggregate_iqm(s)])
        print(library.get_interval_estimates({"x": X}, both, reps=50_000))
    """
    assert estimate(strata(X), statistic).value == pytest.approx(value, abs=1e-8)
    rng = np.random.default_rng(3)
    drawn = [resample(task, rng, DRAWS).reshape(DRAWS, -1) for task in strata(X)]
    values = statistic(np.concatenate(drawn, axis=1))
    bound = share_error((1 - LEVEL) / 2, DRAWS, RLIABLE_DRAWS)
    assert (values < low).mean() == pytest.approx((1 - LEVEL) / 2, abs=bound)
    assert (values > high).mean() == pytest.approx((1 - LEVEL) / 2, abs=bound)


def test_improvement_agrees_with_rliable() -> None:
    """Find rliable's probability of improvement, and its limits but for a step of the count.

    Printed by the same rliable, `np.random.seed(0)` and the estimates above before it:

        print(library.get_interval_estimates(
            {"p": (X, Y)}, metrics.probability_of_improvement, reps=20_000))
    """
    found = improvement(list(zip(strata(X), strata(Y), strict=True)), replicates=DRAWS)
    step = 1 / (3 * len(X) * len(Y))
    assert found.value == pytest.approx(2 / 3, abs=1e-12)
    assert found.low == pytest.approx(0.49305556, abs=1.01 * step)
    assert found.high == pytest.approx(0.82638889, abs=1.01 * step)


def test_spread_of_the_draws_is_that_of_seeds_and_episodes() -> None:
    """Give the draws' mean the variance of seeds over S plus that of episodes over S E."""
    scores = np.random.default_rng(4).random((5, 20)) + np.arange(5)[:, None] / 10
    seeds, episodes = scores.mean(axis=1).var(), scores.var(axis=1).mean()
    drawn = resample(scores, np.random.default_rng(5), DRAWS).mean(axis=(1, 2))
    expected = seeds / 5 + episodes / (5 * 20)
    assert drawn.var() == pytest.approx(expected, rel=5 * math.sqrt(2 / DRAWS))


@pytest.mark.parametrize(("seeds", "share"), [(3, 0.76), (5, 0.85), (10, 0.90)])
def test_few_seeds_give_intervals_that_are_too_short(seeds: int, share: float) -> None:
    """Hold the true mean of normal scores as often as the page says."""
    rng, times = np.random.default_rng(seeds), 1000
    held = 0
    for _ in range(times):
        found = estimate([rng.normal(size=(seeds, 1))], mean, replicates=500)
        held += found.low <= 0 <= found.high
    assert held / times == pytest.approx(share, abs=5 * math.sqrt(share * (1 - share) / times))


def test_interquartile_mean_leaves_out_the_quarters() -> None:
    """Average the middle half, however far the rest lies off."""
    scores = np.array([[-100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 900.0]])
    assert estimate([scores], interquartile_mean).value == 3.5


def test_ties_count_half() -> None:
    """Give equal policies one half, and a policy that always wins one, without an interval."""
    same, better = np.full((3, 4), 0.5), np.full((4, 4), 0.6)
    equal, sure = improvement([(same, same)]), improvement([(better, same)])
    assert (equal.value, equal.low, equal.high) == (0.5, 0.5, 0.5)
    assert (sure.value, sure.low, sure.high) == (1.0, 1.0, 1.0)
    assert improvement([(same, better)]).value == 0.0


def test_a_seed_counts_by_its_mean() -> None:
    """Compare seeds by their mean over episodes, not by their episodes."""
    x, y = np.array([[0.0, 1.0]] * 3), np.array([[0.45, 0.45]] * 3)
    assert improvement([(x, y)]).value == 1.0


def test_equal_scores_give_equal_intervals() -> None:
    """Draw the same way every time, from seeds and from episodes."""
    scores = np.random.default_rng(6).random((4, 10))
    assert estimate([scores], mean) == estimate([scores.copy()], mean)
    assert estimate([scores], mean).low < scores.mean() < estimate([scores], mean).high
