"""What a skin leaves: whether it follows where, how deep and how long taxels are pressed.

A fault that stands in for another one leaves answers that come again wherever the skin is pressed
alike: regressors that a right skin has no use for predict them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit, ndtr

from backends.state import Array
from backends.touch import THRESHOLD_M
from diagnosis.skin.forward_model import ALIKE, Faults, Pressed, expected

DEEPEST_M = 0.5e-3
"""Beyond this, depths count as this."""
BLUR_M, AROUND_M = 5e-5, 5e-3
"""How blurred it is which taxels answer in the nominal skin, and how far that shows around them."""
CLEAR = 4.0
"""No depth counts as farther off than this: a wild answer is no law [standard deviations]."""
RIDGE = 3.0
"""Prior precision of a coefficient, over that of an answer."""


@dataclass(frozen=True, kw_only=True)
class Left:
    """Answers beside what a skin predicts of them, n in all."""

    binary: bool
    shown: Array
    """Logits of the chance of an answer, or nothing of depths, shape (n,)."""
    read: Array
    """Answers as 1 and 0, or errors of depths in standard deviations, shape (n,)."""
    regressors: Array
    """Shape (R, n)."""

    def fitted(self) -> Array:
        """Coefficients (R,) that explain the answers best."""
        start = np.zeros(len(self.regressors))
        return np.asarray(minimize(self._cost, start, jac=True).x)

    def gain(self, coefficients: Array) -> float:
        """How much likelier coefficients (R,) make the answers [nats]."""
        return self._nats(self.shown + coefficients @ self.regressors) - self._nats(self.shown)

    def _nats(self, shown: Array) -> float:
        if self.binary:
            return float((self.read * shown - np.logaddexp(0.0, shown)).sum()) / ALIKE
        return float(((self.read - shown) ** 2).sum()) / (-2 * ALIKE)

    def _cost(self, coefficients: Array) -> tuple[float, Array]:
        shown = self.shown + coefficients @ self.regressors
        chance = expit(shown) if self.binary else shown
        slope = self.regressors @ (chance - self.read) / ALIKE + RIDGE * coefficients
        return RIDGE * float(coefficients @ coefficients) / 2 - self._nats(shown), slope


def left(data: Pressed, faults: Faults, apart: Array, near: Array | None) -> Left:
    """What a skin with faults leaves of its samples; its taxels are `apart` [m], (F, K, K)."""
    shown, regressors = expected(data, faults, near), _regressors(data, apart)
    if data.binary:
        read, every = (data.reading > 0.5).astype(float), np.ones(shown.shape, dtype=bool)
        shown = logit(shown)
    else:
        every = (shown > 0) | (data.reading > 0)
        off_m = _centred(data.reading - shown, every & (data.depth_m > 0))
        read = np.clip(off_m / faults.blurs_m(data), -CLEAR, CLEAR)
        shown = np.zeros(shown.shape)
    return Left(
        binary=data.binary, shown=shown[every], read=read[every], regressors=regressors[:, every]
    )


def _centred(off_m: Array, pressed: Array) -> Array:
    """Errors of depths (S, F, K) where every finger presses as deep as its pressed taxels say.

    Stick and joints are known but to a share of what they press: what is off alike on all that a
    finger presses is where it is, and no fault of its skin.
    """
    for finger in range(off_m.shape[1]):
        some = pressed[:, finger]
        if some.any():
            off_m[:, finger][some] -= np.median(off_m[:, finger][some])
    return off_m


def _regressors(data: Pressed, apart: Array) -> Array:
    """What answers may follow, shape (R, S, F, K).

    A constant, whether a taxel is pressed, how deep, and how near one is that should answer; the
    time, and how the first and the last of these change with it.
    """
    depth_m = np.where(data.touched[..., None], np.clip(data.depth_m, 0.0, DEEPEST_M), 0.0)
    pressed = (depth_m > 0).astype(float)
    answers = ndtr((depth_m - THRESHOLD_M) / BLUR_M)
    weight = np.exp(-apart / AROUND_M)
    around = np.zeros_like(answers)
    for k in range(answers.shape[2]):
        np.maximum(around, answers[..., k, None] * weight[:, k], out=around)
    last_s = data.time_s.max(initial=np.finfo(float).tiny)
    time = np.broadcast_to((data.time_s / last_s)[:, None, None], depth_m.shape)
    alone = [np.ones_like(depth_m), pressed, depth_m / THRESHOLD_M, around]
    return np.stack([*alone, time, time * pressed, time * around])
