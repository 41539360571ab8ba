"""What a table says of a joint, term by term: a regression that takes out what does not show."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import t as student

from diagnosis.logs.log import LogError

SPARE = 2
"""A table needs so many rows more than terms."""
SURE = 0.999
"""A term shows that is other than zero with this one-sided probability; 90 % intervals are said."""
ALIKE = 1.5
"""Another term says the same where it leaves no more than so many times the rest."""
SIGNED = ("zero", "scale", "offset", "weight")
"""Terms that may be negative; the others never are."""


@dataclass(frozen=True, kw_only=True)
class Term:
    """What one joint's rows show of one cause, in SI units."""

    joint: str
    term: str
    value: float
    low: float
    high: float
    shows: bool = True
    """Whether it is some; else the interval bounds it."""
    alike: tuple[str, ...] = ()
    """Terms that would say the same."""


def regress(
    joint: str,
    wanted: np.ndarray,
    columns: Iterable[tuple[str, np.ndarray | str]],
    least: float,
    floor: float,
    shown: str,
) -> tuple[list[Term], list[str]]:
    """The terms of a joint, those that show first; and what the table cannot tell.

    `wanted` (T,) is a sum of `columns` (T,), which a short table loses from the last; for those
    that it does not show, it is said why. A term that moves it by less than `least` is none, and
    no row is surer than `floor`, both in its unit. Raises LogError for too few rows, in words
    `shown`.
    """
    if len(wanted) <= SPARE:
        raise LogError(f"{joint} {shown}; needed: {SPARE + 1} or more")
    there, lacking = dict[str, np.ndarray](), list[str]()
    for term, column in columns:
        if isinstance(column, str):
            lacking.append(column)
        elif len(there) + SPARE < len(wanted):
            there[term] = column
        else:
            lacking.append(f"{term}: there are {len(wanted)} rows; it takes more")
    x, kept = pd.DataFrame(there), list(there)
    whole, _ = fit, rest = _fit(wanted, x, floor)
    while kept:
        fit, rest = _fit(wanted, x[kept], floor)
        sure = fit["size"] / fit["sd"]
        faint = fit["size"] * x[kept].abs().max() < least
        first = (sure[faint] if faint.any() else sure).idxmin()
        if not faint.any() and sure[first] > student.ppf(SURE, len(wanted) - len(kept)):
            break
        kept.remove(first)
    others = [term for term in there if term not in kept]
    alike: dict[str, tuple[str, ...]] = dict.fromkeys(others, ())
    for term in kept:
        beside = [k for k in kept if k != term]
        left = {k: _left(wanted, x[[*beside, k]], floor) for k in others}
        alike[term] = tuple(k for k, size in left.items() if size < ALIKE * rest)
    terms = [
        Term(joint=joint, term=term, shows=shows, alike=alike[term], **row)
        for shows, some, known in ((True, kept, fit), (False, others, whole))
        for term, row in known.loc[some, ["value", "low", "high"]].iterrows()
    ]
    return terms, lacking


def _fit(wanted: np.ndarray, x: pd.DataFrame, floor: float) -> tuple[pd.DataFrame, float]:
    """Least squares: each term with its interval, deviation and size; and what they leave."""
    inverse = np.linalg.pinv(x.T @ x)
    value = inverse @ x.T.to_numpy() @ wanted
    free = len(wanted) - x.shape[1]
    rest = float(np.sqrt(max(((wanted - x @ value) ** 2).sum() / free, floor**2)))
    sd = rest * np.sqrt(np.maximum(np.diag(inverse), 1e-30))
    wide = sd * student.ppf(0.95, free)
    size = [abs(v) if term in SIGNED else v for term, v in zip(x, value, strict=True)]
    columns = {"value": value, "low": value - wide, "high": value + wide, "sd": sd, "size": size}
    return pd.DataFrame(columns, index=x.columns), rest


def _left(wanted: np.ndarray, x: pd.DataFrame, floor: float) -> float:
    """What terms leave; infinite where the last of them would be negative."""
    fit, rest = _fit(wanted, x, floor)
    return rest if fit["size"].iloc[-1] > 0.0 else np.inf
