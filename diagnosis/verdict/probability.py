"""The probability that a verdict is right: the share of right answers among such verdicts.

A logistic curve in what the verdict rests on. Its coefficients stand in one file, and are fitted on
plants with foreign drive laws.
"""

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from diagnosis.verdict.result import UNKNOWN, Cause

NAMED = "named"
FILE = Path(__file__).with_name("curve.json")
"""By kind of verdict, the coefficients of `features`: what `bench blind calibrate` wrote."""
Curve = Mapping[str, Mapping[str, float]]
"""Coefficients by kind of verdict and feature."""
LEAST = 1e-3
RIGHT, RIGHT_UNKNOWN = 0.88, 0.90
"""Shares of effects named on touch, stick and contact, and of gaps called `unknown` there, that
were right where the blind check hid them in grasps."""


def features(
    share: float, gap: float, left: float, ties: int, causes: int, lead: float
) -> dict[str, float]:
    """What the curve depends on; `gap` and `left` are in ordinary gaps."""
    return {
        "constant": 1.0,
        "unshared": math.log(max(1.0 - share, LEAST)),
        "share": min(max(share, 0.0), 1.0),
        "gap": math.log(max(gap, 0.05)),
        "left": math.log(max(left, 0.3)),
        "tied": float(ties > 0),
        "more": float(causes > 1),
        "lead": lead,
    }


@cache
def curve() -> Curve:
    """The coefficients by kind of verdict and feature."""
    return json.loads(FILE.read_text())


def probability(kind: str, values: Mapping[str, float], by: Curve | None = None) -> float:
    """The probability that a verdict of this kind is right, by a curve or the one in `FILE`."""
    score = sum(weight * values[name] for name, weight in (by or curve())[kind].items())
    return 1.0 / (1.0 + math.exp(-score))


def in_hand(cause: Cause) -> float:
    """The probability that a cause on touch, stick or contact is right: shared with what is tied.

    It stands beside the verdict on joints, and neither lends it its confidence nor changes it.
    """
    return RIGHT_UNKNOWN if cause.effect == UNKNOWN else RIGHT / (1 + len(cause.tied))
