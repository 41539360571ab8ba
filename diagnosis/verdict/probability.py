"""The probability that a verdict is right: the share of right answers among such verdicts.

A logistic curve in what the verdict rests on. Its coefficients stand here and nowhere else; they
are fitted on plants with foreign drive laws.
"""

import math

NAMED, UNKNOWN, NONE = "named", "unknown", "none"
CURVE: dict[str, dict[str, float]] = {
    NAMED: {"constant": 0.23, "unshared": -0.39, "left": 0.06, "tied": -0.91, "more": 0.27},
    UNKNOWN: {"constant": 0.5, "gap": 1.51, "share": -0.69},
    NONE: {"constant": 2.02, "gap": -0.84},
}
"""By kind of verdict, the coefficients of `features`."""
LEAST = 1e-3


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


def probability(kind: str, values: dict[str, float]) -> float:
    """The probability that a verdict of this kind is right."""
    score = sum(weight * values[name] for name, weight in CURVE[kind].items())
    return 1.0 / (1.0 + math.exp(-score))
