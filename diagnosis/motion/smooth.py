"""Polynomials through a few samples about each: less noise, no lag (Savitzky and Golay, 1964)."""

import numpy as np

from backends.state import Array


def smooth(values: Array, width: int, degree: int) -> Array:
    """Samples (T, K) as polynomials through `width` of them have them, odd and at most T.

    The first and the last of these polynomials have the ends.
    """
    powers, fit = _basis(width, degree)
    middle, share = width // 2, weights(width, degree)
    about = np.stack([np.convolve(x, share, "valid") for x in values.T], axis=1)
    first, last = (powers @ (fit @ end) for end in (values[:width], values[-width:]))
    return np.concatenate([first[:middle], about, last[middle + 1 :]])


def weights(width: int, degree: int) -> Array:
    """How much of each sample a polynomial has in the middle, shape (width,)."""
    powers, fit = _basis(width, degree)
    return np.asarray(powers[width // 2] @ fit)


def _basis(width: int, degree: int) -> tuple[Array, Array]:
    """Powers of the places (width, P), and what makes their coefficients of samples (P, width)."""
    powers = np.vander(np.linspace(-1.0, 1.0, width), degree + 1)
    return powers, np.linalg.pinv(powers)
