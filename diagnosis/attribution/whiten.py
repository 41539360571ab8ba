"""Innovations of residuals: noise is white, a model's own error comes slowly and stays a while.

The model's error is taken as an Ornstein-Uhlenbeck process beside white noise. A Kalman filter
predicts each residual from the ones before; what it did not predict is white, so its squares add up
to a likelihood, whatever the rate of a log (Anderson and Moore, Optimal Filtering, 1979).
"""

import numba
import numpy as np

from backends.state import Array

MEMORY_S = 0.1
"""How long a model's error stays [s]: friction and play change it at a reversal."""
FAR = 1e4
"""Residuals end here: a candidate that is unstable is merely very bad."""
ROUGH = 0.5
"""No model's error is all slow: the white part is at least this share of the slow one."""
ABSORBED = 10
"""Blocks of innovations whose means a fit makes small by itself: about one per free number."""


@numba.njit(cache=True)
def _innovations(left, white, slow, keep, out):
    channels, samples, joints = left.shape
    for c in range(channels):
        for j in range(joints):
            noise, model = white[c, j] ** 2, slow[c, j] ** 2
            guess, variance = 0.0, model
            gain, root, known = 0.0, 1.0, -1.0
            for k in range(samples):
                if np.isfinite(left[c, k, j]):
                    if variance != known:  # it soon stays as it is
                        spread, known = variance + noise, variance
                        gain, root = variance / spread, np.sqrt(spread)
                    new = left[c, k, j] - guess
                    out[c, k, j] = new / root
                    guess += gain * new
                    variance *= 1 - gain
                else:
                    out[c, k, j] = np.nan
                guess *= keep
                variance = keep * keep * variance + (1 - keep * keep) * model


@numba.njit(cache=True)
def _news(left, white, slow, keep, told, flat):
    new, at = np.empty(left.shape), len(flat) - told.sum()
    _innovations(left, white, slow, keep, new)
    channels, samples, joints = left.shape
    for c in range(channels):
        for j in range(joints):
            for k in range(samples):
                if told[c, j, k]:
                    one = new[c, k, j]
                    flat[at] = FAR if np.isnan(one) else min(max(one, -FAR), FAR)
                    at += 1


def news(left: Array, white: Array, slow: Array, sample_s: float, told: Array, flat: Array) -> None:
    """Write `innovations` of the logged residuals, (C, J, T) bool, at the end of `flat`."""
    _news(left, white, slow, np.exp(-sample_s / MEMORY_S), told, flat)


def innovations(left: Array, white: Array, slow: Array, sample_s: float) -> Array:
    """Innovations over their standard deviations of residuals `left`, both (C, T, J).

    `white` and `slow` are standard deviations (C, J); NaN stays NaN.
    """
    out = np.empty(left.shape)
    _innovations(left, white, slow, np.exp(-sample_s / MEMORY_S), out)
    return out


def surprise(new: Array, tracks: Array, sizes: tuple[int, ...] = (4, 16, 64)) -> float:
    """How far innovations (n,) are from white, in standard deviations.

    Squared means of blocks would be chi-square. The size of block that tells most counts, of all
    innovations or of the track that is worst: of one channel and joint, whose numbers `tracks` (n,)
    are. What is missing on one joint is lost among the others.
    """
    parts = [new, *(new[tracks == track] for track in np.unique(tracks))]
    found = [_excess(_block_squares(part, size)) for part in parts for size in sizes]
    return max(found, default=0.0)


def _excess(squares: Array) -> float:
    """The sum of squared normal variables (n,) as one such variable (Wilson and Hilferty, 1931)."""
    if len(squares) < 2:
        return 0.0
    blur = 2 / (9 * len(squares))
    return float((np.cbrt(squares.mean()) - 1 + blur) / np.sqrt(blur))


def _block_squares(new: Array, size: int) -> Array:
    """Squared block means over their variance."""
    count = len(new) // size
    return size * new[: count * size].reshape(count, size).mean(axis=1) ** 2


def alike(new: Array, size: int = 64) -> float:
    """Variance of block means over what white innovations have, at least 1."""
    squares = _block_squares(new, size)
    return max(1.0, float(squares.mean())) if len(squares) else 1.0


def dispersion(new: Array, size: int = 64) -> float:
    """Variance of block means over what white innovations have: of slow errors over expected ones.

    As if `ABSORBED` more blocks were as expected: a fit takes up as many.
    """
    squares = _block_squares(new, size)
    return float((squares.sum() + ABSORBED) / (len(squares) + ABSORBED))
