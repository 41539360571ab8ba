"""Figures of a score: shares or medians over some cases, with count and interval."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

LEVEL = 0.95
"""Coverage of the intervals: Wilson for shares, order statistics for medians."""


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure."""

    value: float | None
    """None if there is nothing to count."""
    low: float | None
    high: float | None
    count: int


@dataclass(frozen=True)
class Measure:
    """Definition of a figure."""

    name: str
    column: str
    of: Callable[[pd.DataFrame], pd.Series]
    """Selects the rows that count."""
    meaning: str
    median: bool = False
    faults: bool = False
    """Whether it is over true effects instead of cases."""


def share(hits: pd.Series) -> Figure:
    """Share of hits among the values that are not empty."""
    hits = hits.dropna().astype(bool)
    if hits.empty:
        return Figure(value=None, low=None, high=None, count=0)
    found = stats.binomtest(int(hits.sum()), len(hits))
    interval = found.proportion_ci(LEVEL, method="wilson")
    return Figure(
        value=float(hits.mean()),
        low=float(interval.low),
        high=float(interval.high),
        count=len(hits),
    )


def median(values: pd.Series) -> Figure:
    """Median of the values that are not empty; its interval is between two order statistics."""
    numbers = np.sort(values.dropna().to_numpy(dtype=float))
    if not len(numbers):
        return Figure(value=None, low=None, high=None, count=0)
    first = int(stats.binom.ppf((1 - LEVEL) / 2, len(numbers), 0.5))
    ends = numbers[max(first - 1, 0)], numbers[min(len(numbers) - first, len(numbers) - 1)]
    return Figure(
        value=float(np.median(numbers)), low=float(ends[0]), high=float(ends[1]), count=len(numbers)
    )


def _mode(name: str) -> Callable[[pd.DataFrame], pd.Series]:
    return lambda t: (t["mode"] == name) & t["detectable"]


_single, _pair, _unknown = map(_mode, ("single", "pair", "unknown"))


def _named(t: pd.DataFrame) -> pd.Series:
    return _single(t) & t["one_of"]


def _faulty(t: pd.DataFrame) -> pd.Series:
    return t["mode"].isin(["single", "pair"]) & t["detectable"]


def _below(t: pd.DataFrame) -> pd.Series:
    return t["mode"].isin(["single", "unknown"]) & ~t["detectable"]


def _none(t: pd.DataFrame) -> pd.Series:
    return t["mode"] == "none"


def _every(t: pd.DataFrame) -> pd.Series:
    return t["number"] >= 0


MEASURES = (
    Measure("top1", "right", _single, "single effects: named, and nothing else"),
    Measure(
        "top1_or_tied",
        "right_or_tied",
        _single,
        "the same, or one named that the solver cannot distinguish from it",
    ),
    Measure("top3", "in_top", _single, "single effects: among the first three of the ranking"),
    Measure("joint_right", "joints_right", _named, "single effects named: on exactly their joints"),
    Measure("none_false_alarm", "wrong", _none, "cases of `none` not called `none`"),
    Measure("none_accused", "accuses", _none, "cases of `none` in which an effect is named"),
    Measure(
        "unknown_recall",
        "right",
        _unknown,
        "effects outside the catalogue, beyond what is ordinary: called `unknown`",
    ),
    Measure("unknown_near", "near", _unknown, "of these: given a near name"),
    Measure(
        "unknown_seen_or_near",
        "right_or_near",
        _unknown,
        "of these: called `unknown`, or given a near name",
    ),
    Measure("pairs_exact", "right", _pair, "pairs: both named, and nothing else"),
    Measure("pairs_one", "one_of", _pair, "pairs: at least one named"),
    Measure(
        "spurious_second",
        "spurious",
        _single,
        "single effects: named together with another one that is not there",
    ),
    Measure(
        "magnitude_error_median",
        "error",
        _faulty,
        "effects found: relative error of the magnitude",
        median=True,
        faults=True,
    ),
    Measure(
        "interval_coverage",
        "covered",
        _faulty,
        "of these: 90 % interval holds the true magnitude",
        faults=True,
    ),
    Measure(
        "shrinkage_vs_oracle",
        "shrinkage_ratio",
        _faulty,
        "share of the gap that the verdict takes, over what the true effects take",
        median=True,
    ),
    Measure(
        "below_named", "right", _below, "effects too small to detect: called right all the same"
    ),
    Measure("below_none", "says_none", _below, "of these: called `none`"),
    Measure("cpu_s_median", "cpu_s", _every, "CPU seconds per case", median=True),
)


def figures(cases: pd.DataFrame, faults: pd.DataFrame) -> dict[str, Figure]:
    """All figures of some cases and the true effects in them."""
    found = {}
    for measure in MEASURES:
        table = faults if measure.faults else cases
        column = table[measure.column][measure.of(table)] if len(table) else pd.Series(dtype=float)
        found[measure.name] = median(column) if measure.median else share(column)
    return found
