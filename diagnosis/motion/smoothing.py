"""Polynomials through some samples around each: less noise, no lag.

Savitzky and Golay, Analytical Chemistry 36 (1964). SciPy has the same in `signal`, which takes as
long to import as a small search.
"""

import numpy as np

from backends.state import Array


def smooth(samples: Array, width: int, degree: int) -> Array:
    """Rows (T, ...) at the middle of polynomials through `width` of them, an odd number up to T.

    The first and last ones are on the polynomial through those at the end.
    """
    fitted, half = hat(width, degree), width // 2
    middle = np.zeros_like(samples[width - 1 :])
    for k, weight in enumerate(fitted[half]):
        middle += weight * samples[k : k + len(middle)]
    begin = np.tensordot(fitted[:half], samples[:width], 1)
    end = np.tensordot(fitted[half + 1 :], samples[-width:], 1)
    return np.concatenate([begin, middle, end])


def hat(width: int, degree: int) -> Array:
    """What a polynomial through values (width,) is at each of them, of each (width, width)."""
    base, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, width), degree + 1))
    return base @ base.T
