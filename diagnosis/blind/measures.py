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


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Definition of a figure."""

    name: str
    meaning: str
    column: str
    of: Callable[[pd.DataFrame], pd.Series]
    """Selects the rows that count."""
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


def _named(t: pd.DataFrame) -> pd.Series:
    return _mode("single")(t) & t["one_of"]


def _faulty(t: pd.DataFrame) -> pd.Series:
    return t["mode"].isin(["single", "pair"]) & t["detectable"]


def _below(t: pd.DataFrame) -> pd.Series:
    return t["mode"].isin(["single", "unknown"]) & ~t["detectable"]


def _none(t: pd.DataFrame) -> pd.Series:
    return t["mode"] == "none"


MEASURES = (
    Measure(
        name="top1",
        meaning="single effects: named, and nothing else",
        column="right",
        of=_mode("single"),
    ),
    Measure(
        name="top1_or_tied",
        meaning="the same, or one named that the solver cannot distinguish from it",
        column="right_or_tied",
        of=_mode("single"),
    ),
    Measure(
        name="top3",
        meaning="single effects: among the first three of the ranking",
        column="in_top",
        of=_mode("single"),
    ),
    Measure(
        name="joint_right",
        meaning="single effects named: on exactly their joints",
        column="joints_right",
        of=_named,
    ),
    Measure(
        name="none_false_alarm",
        meaning="cases of `none` not called `none`",
        column="wrong",
        of=_none,
    ),
    Measure(
        name="none_accused",
        meaning="cases of `none` in which an effect is named",
        column="accuses",
        of=_none,
    ),
    Measure(
        name="unknown_recall",
        meaning="effects outside the catalogue, beyond what is ordinary: called `unknown`",
        column="right",
        of=_mode("unknown"),
    ),
    Measure(
        name="unknown_near",
        meaning="of these: given a near name",
        column="near",
        of=_mode("unknown"),
    ),
    Measure(
        name="unknown_seen_or_near",
        meaning="of these: called `unknown`, or given a near name",
        column="right_or_near",
        of=_mode("unknown"),
    ),
    Measure(
        name="pairs_exact",
        meaning="pairs: both named, and nothing else",
        column="right",
        of=_mode("pair"),
    ),
    Measure(
        name="pairs_one",
        meaning="pairs: at least one named",
        column="one_of",
        of=_mode("pair"),
    ),
    Measure(
        name="spurious_second",
        meaning="single effects: named together with another one that is not there",
        column="spurious",
        of=_mode("single"),
    ),
    Measure(
        name="magnitude_error_median",
        meaning="effects found: relative error of the magnitude",
        column="error",
        of=_faulty,
        median=True,
        faults=True,
    ),
    Measure(
        name="interval_coverage",
        meaning="of these: 90 % interval holds the true magnitude",
        column="covered",
        of=_faulty,
        faults=True,
    ),
    Measure(
        name="shrinkage_vs_oracle",
        meaning="share of the gap that the verdict takes, over what the true effects take",
        column="shrinkage_ratio",
        of=_faulty,
        median=True,
    ),
    Measure(
        name="below_named",
        meaning="effects too small to detect: called right all the same",
        column="right",
        of=_below,
    ),
    Measure(name="below_none", meaning="of these: called `none`", column="says_none", of=_below),
    Measure(
        name="cpu_s_median",
        meaning="CPU seconds per case",
        column="cpu_s",
        of=lambda t: t["number"] >= 0,
        median=True,
    ),
)


def enriched(cases: pd.DataFrame) -> pd.DataFrame:
    """The cases with columns that are derived from the others."""
    oracle = pd.to_numeric(cases["share_oracle"]).where(lambda s: s > 0)
    return cases.assign(
        wrong=~cases["right"],
        says_none=cases["verdict"] == "none",
        shrinkage_ratio=pd.to_numeric(cases["share"]) / oracle,
    )


def figures(cases: pd.DataFrame, faults: pd.DataFrame) -> dict[str, Figure]:
    """All figures of some cases and the true effects in them."""
    found = {}
    for measure in MEASURES:
        table = faults if measure.faults else cases
        column = table[measure.column][measure.of(table)] if len(table) else pd.Series(dtype=float)
        found[measure.name] = median(column) if measure.median else share(column)
    return found
