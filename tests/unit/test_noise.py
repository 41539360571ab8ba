"""Counter-based noise: SplitMix64 written down again, its distribution, and its independence."""

import numba
import numpy as np
import pytest

from backends.noise import normal, uniform
from backends.state import Array

_MASK = (1 << 64) - 1
N = 40_000


def split_mix(seed: int, tick: int, place: int) -> float:
    """The draw in Python's own integers: two rounds of SplitMix64 over the mixed counters."""
    mixed = seed * 0x9E3779B97F4A7C15 & _MASK
    mixed ^= tick * 0xC2B2AE3D27D4EB4F & _MASK
    mixed ^= place * 0x165667B19E3779F9 & _MASK
    for _ in range(2):
        mixed = (mixed + 0x9E3779B97F4A7C15) & _MASK
        mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9 & _MASK
        mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EB & _MASK
        mixed ^= mixed >> 31
    return (mixed >> 11) * 2.0**-53


@numba.njit
def draws(kind, seeds, ticks, places):
    """Draws at each of the counters."""
    out = np.empty(seeds.size)
    for i in range(seeds.size):
        if kind == 0:
            out[i] = uniform(seeds[i], ticks[i], places[i])
        else:
            out[i] = normal(seeds[i], ticks[i], places[i])
    return out


def along(axis: int, kind: int = 0, at: tuple[int, int, int] = (11, 5, 3)) -> Array:
    """N draws in which one of the counters (seed, tick, place) counts up."""
    counters = np.tile(np.array(at)[:, None], (1, N))
    counters[axis] += np.arange(N)
    return draws(kind, *counters)


every_counter = pytest.mark.parametrize("axis", range(3), ids=["seed", "tick", "place"])


@pytest.mark.parametrize(
    "counters", [(0, 0, 0), (1, 2, 3), (7, 0, 1), (2**53 - 1, 300, 12), (123456789, 6000, 0)]
)
def test_draw_is_split_mix(counters: tuple[int, int, int]) -> None:
    """Give to the bit what Python's integers give, in all of the seeds' range."""
    assert uniform(*counters) == split_mix(*counters)


@every_counter
def test_draws_are_uniform(axis: int) -> None:
    """Fill a hundred bins evenly: chi-squared within four standard deviations of its mean."""
    drawn = along(axis)
    assert drawn.min() >= 0.0
    assert drawn.max() < 1.0
    counts, _ = np.histogram(drawn, 100, (0.0, 1.0))
    chi2 = ((counts - N / 100) ** 2 / (N / 100)).sum()
    assert abs(chi2 - 99) < 4 * np.sqrt(2 * 99)


@every_counter
def test_neighbours_are_independent(axis: int) -> None:
    """Correlate with the next draws, and with those of a neighbouring stream, by chance alone."""
    drawn = along(axis) - 0.5
    bound = 4 / 12 / np.sqrt(N)
    for lag in (1, 2, 3, 20):
        assert abs((drawn[lag:] * drawn[:-lag]).mean()) < bound
    for other in range(3):
        if other != axis:
            at = [11, 5, 3]
            at[other] += 1
            assert abs((drawn * (along(axis, at=tuple(at)) - 0.5)).mean()) < bound


@every_counter
def test_normal_draws_are_normal(axis: int) -> None:
    """Have mean 0, variance 1, no skew and kurtosis 3, each within four standard errors."""
    drawn = along(axis, kind=1)
    assert abs(drawn.mean()) < 4 / np.sqrt(N)
    assert abs(drawn.var() - 1) < 4 * np.sqrt(2 / N)
    assert abs((drawn**3).mean()) < 4 * np.sqrt(15 / N)
    assert abs((drawn**4).mean() - 3) < 4 * np.sqrt(96 / N)
    assert 3.0 < np.abs(drawn).max() < 6.0


def test_no_two_counters_share_a_draw() -> None:
    """Give different numbers to all of 40 seeds x 100 ticks x 16 places."""
    seeds, ticks, places = (a.ravel() for a in np.indices((40, 100, 16)))
    assert len(set(draws(0, seeds, ticks, places))) == seeds.size


def test_draws_know_no_history() -> None:
    """Give in reverse order what they give in order."""
    counters = np.zeros((3, 500), dtype=int)
    counters[1] = np.arange(500)
    forward = draws(1, *counters)
    assert np.array_equal(draws(1, *counters[:, ::-1])[::-1], forward)
