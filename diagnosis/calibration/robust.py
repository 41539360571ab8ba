"""Least absolute errors, a fit that a few outliers hardly change."""

import numpy as np

from backends.state import Array

_SWEEPS = 40
"""Number of reweightings of the least squares."""


def least_absolute(miss: Array, columns: Array, times: Array | float = 1.0) -> Array:
    """The x (C,) that minimises the sum of times |miss - columns x| over T samples.

    By reweighted least squares (Schlossmacher, J. Am. Stat. Assoc. 68, 1973).
    """
    smallest = 1e-3 * np.median(np.abs(miss)) + 1e-9
    x = np.zeros(columns.shape[1])
    for _ in range(_SWEEPS):
        weight = times / np.maximum(np.abs(miss - columns @ x), smallest)
        weighted = columns * weight[:, None]
        x = np.linalg.lstsq(weighted.T @ columns, weighted.T @ miss, rcond=None)[0]
    return x
