"""Tables of a score: by side, confusion, per effect, calibration, baselines."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from backends.state import Array
from diagnosis.blind.faults import LEVELS
from diagnosis.blind.measures import Figure, figures, share

GROUPS = ("real", "rig", "channels", "protocols")
BINS = 4
"""Bins of equal counts in which confidence is held against the share right."""
CONFIDENCES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Limits of the bins of the reliability table."""
FOUND_SHARE = 0.5
"""An effect counts as found at a level if this share of its cases is found."""
COMPARED = (
    "top1",
    "top1_or_tied",
    "top3",
    "joint_right",
    "none_false_alarm",
    "unknown_recall",
    "pairs_exact",
    "pairs_one",
    "spurious_second",
)
"""The figures of a baseline."""


def by_group(cases: pd.DataFrame, faults: pd.DataFrame) -> pd.DataFrame:
    """All figures for every real side, rig, set of channels and set of protocols."""
    rows = []
    for group in GROUPS:
        for name in sorted(cases[group].unique()):
            part = cases[cases[group] == name]
            inside = faults[faults["number"].isin(part["number"])]
            rows.append({"by": group, "of": name, "cases": len(part), **flat(part, inside)})
    return pd.DataFrame(rows)


def confidence(cases: pd.DataFrame) -> pd.DataFrame:
    """`excess` of cases whose confidence is judged: `none`, and detectable ones."""
    some = cases[(cases["mode"] == "none") | cases["detectable"]]
    some = some[pd.to_numeric(some["confidence"]).notna()]
    said, right = (some[name].to_numpy(dtype=float) for name in ("confidence", "right_or_near"))
    return excess(said, right, some["real"].to_numpy())


def excess(confidence: Array, right: Array, real: Array) -> pd.DataFrame:
    """Mean confidence and share right of some cases (N,).

    Of all, by real side, and in bins of equal counts by confidence.
    """
    parts = {"all": np.arange(len(real))}
    parts |= {str(side): np.flatnonzero(real == side) for side in np.unique(real)}
    bins = np.array_split(np.argsort(confidence, kind="stable"), BINS)
    parts |= {f"bin {k + 1}": part for k, part in enumerate(bins)}
    rows = [
        (
            *(name, len(part), confidence[part].min(), confidence[part].max()),
            *(confidence[part].mean(), right[part].mean()),
            confidence[part].mean() - right[part].mean(),
        )
        for name, part in parts.items()
        if len(part)
    ]
    columns = ["of", "cases", "from", "to", "confidence", "right", "excess"]
    return pd.DataFrame(rows, columns=columns)


def flat(cases: pd.DataFrame, faults: pd.DataFrame) -> dict[str, float | int | None]:
    """Figures with their counts."""
    found: dict[str, float | int | None] = {}
    for name, figure in figures(cases, faults).items():
        found |= {name: figure.value, f"{name}_n": figure.count}
    return found


def confusion(cases: pd.DataFrame) -> pd.DataFrame:
    """Counts of verdicts (columns) by truth (rows), over detectable cases without pairs."""
    judged = cases[(cases["mode"] == "none") | (cases["detectable"] & (cases["mode"] != "pair"))]
    return pd.crosstab(judged["truth"], judged["verdict"]).reset_index()


def by_effect(faults: pd.DataFrame) -> pd.DataFrame:
    """Per effect and protocols: found per level, and the smallest magnitude found."""
    rows = []
    single = faults[faults["mode"] == "single"]
    for (effect, unit, protocols), part in single.groupby(["effect", "unit", "protocols"]):
        row = {"effect": effect, "protocols": protocols, "unit": unit, "smallest": None}
        for level in reversed(LEVELS):
            tried = part[part["level"] == level]
            row |= {f"{level}_found": int(tried["found"].sum()), f"{level}_cases": len(tried)}
            if len(tried) and tried["found"].mean() >= FOUND_SHARE:
                row["smallest"] = float(tried["magnitude"].median())
        rows.append(row)
    columns = ["effect", "protocols", "unit", "smallest"]
    columns += [f"{level}_{what}" for level in LEVELS for what in ("found", "cases")]
    return pd.DataFrame(rows, columns=columns)


def reliability(cases: pd.DataFrame) -> pd.DataFrame:
    """Share of right verdicts by confidence, over `none` and detectable cases."""
    judged = cases[(cases["mode"] == "none") | cases["detectable"]]
    confidence = pd.to_numeric(judged["confidence"])
    rows = []
    for low, high in zip(CONFIDENCES[:-1], CONFIDENCES[1:], strict=True):
        last = high == CONFIDENCES[-1]
        inside = (confidence >= low) & ((confidence < high) | (last & (confidence <= high)))
        right = share(judged["right"][inside])
        mean = float(confidence[inside].mean()) if inside.any() else None
        rows.append({"from": low, "to": high, "confidence": mean, **vars(right)})
    return pd.DataFrame(rows)


def baselines(cases: pd.DataFrame, faults: pd.DataFrame) -> pd.DataFrame:
    """The solver and simpler methods on the same cases."""
    rows: list[dict[str, object]] = [{"method": "this solver", **_values(figures(cases, faults))}]
    rows.append({"method": "chance: an effect of the catalogue at random", **_chance(cases)})
    for method, verdict in _RIVALS.items():
        found = figures(_restated(cases, verdict(cases)), faults)
        known = {k: v for k, v in _values(found).items() if k != "joint_right"}
        rows.append({"method": method, **known})
    return pd.DataFrame(rows, columns=["method", *COMPARED])


def _values(found: dict[str, Figure]) -> dict[str, float | None]:
    return {name: found[name].value for name in COMPARED}


def _chance(cases: pd.DataFrame) -> dict[str, float]:
    """Expected figures of naming one effect at random."""
    one = float((1 / cases["catalogue"]).mean())
    return {
        "top1": one,
        "top1_or_tied": one,
        "top3": 3 * one,
        "none_false_alarm": 1.0,
        "unknown_recall": 0.0,
        "pairs_exact": 0.0,
        "pairs_one": 2 * one,
        "spurious_second": 0.0,
    }


_RIVALS: dict[str, Callable[[pd.DataFrame], pd.Series]] = {
    "nominal parameters refitted alone": lambda t: pd.Series("none", index=t.index),
    "the effect that takes most of the gap": lambda t: t["first"].fillna("none"),
}
"""Baselines by what they say of the same cases."""


def _restated(cases: pd.DataFrame, verdict: pd.Series) -> pd.DataFrame:
    """The cases with another verdict of one word."""
    truths = cases["truth"].str.split(" + ", regex=False)
    named = pd.Series([v in t for v, t in zip(verdict, truths, strict=True)], index=cases.index)
    right = verdict == cases["truth"]
    return cases.assign(
        verdict=verdict,
        right=right,
        right_or_tied=right,
        right_or_near=right,
        near=False,
        wrong=~right,
        one_of=named & (verdict != "none"),
        in_top=named & (verdict != "none"),
        spurious=False,
        joints_right=None,
        accuses=verdict != "none",
    )


def markdown(table: pd.DataFrame) -> str:
    """A table in Markdown."""
    head = [str(column) for column in table.columns]
    lines = [head, ["---"] * len(head)]
    lines += [[cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def cell(value: object) -> str:
    """A value in a table: numbers to three digits, empty for None."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)
