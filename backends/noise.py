"""Counter-based noise: a draw depends on seed, time and place only, never on earlier draws.

So worlds see the same noise when they are resumed, reordered or split over processes.
"""

import math

import numba
import numpy as np


@numba.njit(cache=True)
def uniform(seed, tick, place):
    """A number in [0, 1) from three counters: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014)."""
    mixed = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= np.uint64(tick) * np.uint64(0xC2B2AE3D27D4EB4F)
    mixed ^= np.uint64(place) * np.uint64(0x165667B19E3779F9)
    for _ in range(2):
        mixed += np.uint64(0x9E3779B97F4A7C15)
        mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        mixed ^= mixed >> np.uint64(31)
    return float(mixed >> np.uint64(11)) * 2.0**-53


@numba.njit(cache=True)
def normal(seed, tick, place):
    """A standard normal number (Box and Muller)."""
    u, v = uniform(seed, tick, 2 * place), uniform(seed, tick, 2 * place + 1)
    return math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2.0 * math.pi * v)
