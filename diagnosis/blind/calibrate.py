"""Fit the probability that a verdict is right, as a curve in its features.

The features are the share of the gap that is explained, what is left, the lead over other
candidates, and the kind of verdict. The share of right answers is a logistic curve in the features,
one per kind, fitted to solved sets whose answers are open. Each plant is tested with the curve of
all other plants, because a user's robot is yet another one.

Every coefficient but the constant has a normal prior with standard deviation one (ridge
regression). The features are logarithms and shares, so this suits their scale.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from backends.catalogue import catalogue
from backends.state import Array
from diagnosis.blind import judged
from diagnosis.blind.files import BlindError, BlindSet, open_answers
from diagnosis.blind.tables import excess
from diagnosis.verdict.probability import NAMED, Curve, probability
from diagnosis.verdict.result import NONE, UNKNOWN

FEATURES: Mapping[str, Mapping[str, int]] = {
    NAMED: {"constant": 0, "unshared": -1, "left": -1, "tied": -1, "more": -1, "lead": 1},
    UNKNOWN: {"constant": 0, "gap": 1, "share": -1},
    NONE: {"constant": 0, "gap": -1},
}
"""The features for each kind of verdict, the constant first, and the sign that each may have: a
cause that explains more is never less sure."""
PRIOR_SD, CONSTANT_SD = 1.0, 10.0
"""Standard deviations of the coefficients' normal priors."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One verdict of a solved case whose answer is open."""

    make: str
    """Real side that it was reached on."""
    kind: str
    """named, unknown or none."""
    features: Mapping[str, float]
    """Its features, by name; `constant` is 1."""
    right: bool


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """A fitted curve, and its calibration on plants that it was not fitted on."""

    curve: Curve
    """Fitted on all rows."""
    left_out: Array
    """Probability of every row by the curve of all other plants, shape (N,)."""
    table: pd.DataFrame
    """See `tables.excess`."""


def fit(every: Sequence[Row]) -> Curve:
    """The maximum posterior curve for some rows; a kind without rows gets probability 0.5."""
    curve = dict[str, dict[str, float]]()
    for kind, wanted in FEATURES.items():
        some = [row for row in every if row.kind == kind]
        x = np.array([[row.features[name] for name in wanted] for row in some])
        right = np.array([row.right for row in some], dtype=float)
        found = _logistic(x.reshape(-1, len(wanted)), right, list(wanted.values()))
        curve[kind] = dict(zip(wanted, map(float, found.round(4)), strict=True))
    return curve


def _logistic(x: Array, right: Array, signs: Sequence[int]) -> Array:
    """Coefficients of the maximum posterior, of these signs; the first feature is the constant."""
    held = np.full(x.shape[1], PRIOR_SD)
    held[0] = CONSTANT_SD

    def cost(some: Array) -> float:
        score = x @ some
        unlikely = np.logaddexp(0.0, score).sum() - right @ score
        return float(unlikely + np.sum((some / held) ** 2) / 2)

    bounds = [(0.0 if sign > 0 else None, 0.0 if sign < 0 else None) for sign in signs]
    return np.asarray(minimize(cost, np.zeros(x.shape[1]), bounds=bounds, tol=1e-12).x)


def calibrate(some: Sequence[Row]) -> Calibration:
    """The curve of all rows, and each plant by the curve of the others.

    Raises ValueError if all rows are from one plant.
    """
    makes = sorted({row.make for row in some})
    if len(makes) < 2:
        raise ValueError(
            f"all cases are of one real side, {', '.join(makes) or 'none'}; a curve is tested on "
            "plants that it was not fitted on: give sets of two or more"
        )
    left_out = np.empty(len(some))
    for make in makes:
        curve = fit([row for row in some if row.make != make])
        for k, row in enumerate(some):
            if row.make == make:
                left_out[k] = probability(row.kind, row.features, curve)
    right = np.array([row.right for row in some], dtype=float)
    table = excess(left_out, right, np.array([row.make for row in some]))
    return Calibration(curve=fit(some), left_out=left_out, table=table)


def rows(sets: Iterable[tuple[BlindSet, Path]]) -> list[Row]:
    """The verdicts of solved sets of drawn robots; raises BlindError for wrong answers or none.

    A case that the solver refused has no verdict.
    """
    found = []
    for blind, answers in sets:
        opened = open_answers(answers, blind.commitment())
        healthy = int(opened.settings.get("healthy", 0))
        for case in opened.cases:
            said = blind.read_result(case.number)
            if said is None or "features" not in said and not said.get("refused"):
                raise BlindError(
                    f"case {case.number:03d} of {blind.path} has no verdict with its features; "
                    "solve it with: bench blind run"
                )
            if not said.get("refused"):
                beyond = not judged.is_ordinary(case, healthy)
                right, near = judged.rightness(case, said, beyond)
                found.append(
                    Row(
                        make=case.real,
                        kind=_kind(said["verdict"]),
                        features=said["features"],
                        right=right or near,
                    )
                )
    return found


def _kind(verdict: Sequence[str]) -> str:
    """The kind of what the fit says: findings about sensors and packets stand beside it."""
    if UNKNOWN in verdict:
        return UNKNOWN
    fitted = [
        name for name in verdict if name in catalogue() and catalogue()[name].least is not None
    ]
    return NAMED if fitted else NONE
