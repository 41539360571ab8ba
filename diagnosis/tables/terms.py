"""What a table says of a joint, term by term: a regression that takes out what does not show."""

from collections.abc import Iterable, Sequence
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
        raise LogError(f"{shown}; needed: {SPARE + 1} or more")
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
    alike = {
        term: tuple(k for k in others if _leaves(wanted, x, kept, term, k, floor) < ALIKE * rest)
        for term in kept
    }
    terms = list[Term]()
    for some, known in ((kept, fit), (others, whole)):
        wide = known["sd"] * student.ppf(0.95, len(wanted) - len(known))
        ends = known.assign(low=known["value"] - wide, high=known["value"] + wide)
        rows = ends.loc[some, ["value", "low", "high"]].rename_axis("term").reset_index()
        for row in rows.to_dict("records"):
            more = alike.get(row["term"], ())
            terms.append(Term(joint=joint, shows=some is kept, alike=more, **row))
    return terms, lacking


def _fit(wanted: np.ndarray, x: pd.DataFrame, floor: float) -> tuple[pd.DataFrame, float]:
    """Least squares: value, standard deviation and size of each term, and that of the rest."""
    inverse = np.linalg.pinv(x.T @ x)
    value = inverse @ x.T.to_numpy() @ wanted
    free = len(wanted) - x.shape[1]
    rest = float(np.sqrt(max(((wanted - x @ value) ** 2).sum() / free, floor**2)))
    sd = rest * np.sqrt(np.maximum(np.diag(inverse), 1e-30))
    size = [abs(v) if term in SIGNED else v for term, v in zip(x, value, strict=True)]
    return pd.DataFrame({"value": value, "sd": sd, "size": size}, index=x.columns), rest


def _leaves(
    wanted: np.ndarray,
    x: pd.DataFrame,
    kept: Sequence[str],
    term: str,
    other: str,
    floor: float,
) -> float:
    """What is left with another term in the place of one; infinite where it would be negative."""
    fit, rest = _fit(wanted, x[[*(k for k in kept if k != term), other]], floor)
    return rest if fit["size"][other] > 0.0 else np.inf
