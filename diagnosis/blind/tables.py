"""Tables of a score: by side, confusion, per effect, calibration, baselines."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from diagnosis.blind.faults import LEVELS
from diagnosis.blind.measures import Figure, figures, share

GROUPS = ("real", "rig", "channels", "protocols")
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


def by_side(cases: pd.DataFrame, faults: pd.DataFrame) -> pd.DataFrame:
    """Figures of every real side: shares right by mode, coverage, and confidence."""
    rows = []
    for real in (*sorted(cases["real"].unique()), "all"):
        part = cases if real == "all" else cases[cases["real"] == real]
        inside = faults[faults["number"].isin(part["number"])]
        row: dict[str, object] = {"real": real, "cases": len(part)}
        for name, found in side_figures(part, inside).items():
            row |= {name: found.value, f"{name}_n": found.count}
        rows.append(row | {"confidence_excess": _excess(part)})
    return pd.DataFrame(rows)


def side_figures(cases: pd.DataFrame, faults: pd.DataFrame) -> dict[str, Figure]:
    """Figures of one real side."""
    seen = cases[cases["detectable"]]
    mode = {name: seen[seen["mode"] == name] for name in ("single", "pair", "unknown")}
    none = cases[cases["mode"] == "none"]
    covered = faults["covered"][faults["detectable"].astype(bool)] if len(faults) else pd.Series()
    return {
        "singles": share(mode["single"]["right"]),
        "singles_or_tied": share(mode["single"]["right_or_tied"]),
        "none": share(none["right"]),
        "none_accused": share(none["accuses"]),
        "unknown_seen": share(mode["unknown"]["right"]),
        "unknown_near": share(mode["unknown"]["near"]),
        "unknown_seen_or_near": share(mode["unknown"]["right_or_near"]),
        "pairs": share(mode["pair"]["right"]),
        "coverage": share(covered),
    }


def _excess(cases: pd.DataFrame) -> float | None:
    """Mean confidence less share right."""
    some = judged_ones(cases)
    gap = pd.to_numeric(some["confidence"]) - some["right_or_near"].astype(float)
    return float(gap.mean()) if gap.notna().any() else None


def judged_ones(cases: pd.DataFrame) -> pd.DataFrame:
    """Cases whose confidence is judged: `none`, and detectable ones."""
    some = cases[(cases["mode"] == "none") | cases["detectable"]]
    return some[pd.to_numeric(some["confidence"]).notna()]


def confidence(cases: pd.DataFrame, bins: int = 4) -> pd.DataFrame:
    """Mean confidence and share right of all, and in bins of equal counts by confidence."""
    some = judged_ones(cases).sort_values("confidence", kind="stable")
    said = pd.to_numeric(some["confidence"]).to_numpy(dtype=float)
    right = some["right_or_near"].to_numpy(dtype=float)
    parts = {"all": np.arange(len(some))}
    parts |= {str(k + 1): one for k, one in enumerate(np.array_split(parts["all"], bins))}
    rows = [
        {
            "bin": name,
            "cases": len(part),
            "from": float(said[part].min()),
            "to": float(said[part].max()),
            "confidence": float(said[part].mean()),
            "right": float(right[part].mean()),
            "excess": float(said[part].mean() - right[part].mean()),
        }
        for name, part in parts.items()
        if len(part)
    ]
    columns = ["bin", "cases", "from", "to", "confidence", "right", "excess"]
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
