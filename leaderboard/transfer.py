"""The cost of transfer between worlds, from the scores of single episodes.

A row of the episodes table is one episode of one policy in one world, see `COLUMNS`. Worlds are
given by name, so that the statistics can be made again from the file.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from leaderboard.statistics import LEVEL, REPLICATES, SEED, Array, Estimate, mean, resample
from leaderboard.tables import MIN_SEEDS

FIGURE = ("task", "radius_m", "speed", "stick")
"""What is drawn: policies are compared if these are equal."""
IDENTITY = (
    *FIGURE,
    *("observation", "algo", "steps", "randomize", "spread", "start_spread", "worlds", "hand"),
    "smoke",
)
"""Policies that are equal in these and in their train world differ only in their seed."""
SCORES = ("tracked", "held", "p_err_cm", "q_err_deg")
COLUMNS = (*IDENTITY, "policy", "seed", "train", "deploy", "floor", "episode", *SCORES)
"""Columns of the episodes table.

`train` and `deploy` name worlds. `floor` marks episodes that start from other initial states than
the episodes of the same number in other rows.
"""
AGREEMENT = (
    *(*FIGURE, "world", "floor", "policies"),
    *("pearson", "pearson_low", "pearson_high", "mmrv", "note"),
)
"""Columns of the rank agreement."""
MIN_POLICIES = 3
"""Two points always lie on a line."""
SEEDS_TOO, EPISODES_ALONE = "seeds and episodes", "episodes alone"


def matrix(episodes: pd.DataFrame) -> pd.DataFrame:
    """One line per kind of policy, train world and deploy world.

    `tracked`, its `retention` (deploy over train, same initial states) and its `floor` (train world
    from other initial states, over train) come with intervals, of the bootstrap over seeds and
    episodes, or over episodes alone where there are fewer than MIN_SEEDS seeds.
    """
    lines = []
    for key, kind in episodes.groupby([*IDENTITY, "train"], sort=False):
        shared = dict(zip((*IDENTITY, "train"), key, strict=True))
        at_home = kind[kind["deploy"] == shared["train"]]
        again = _tracked(at_home[at_home["floor"]])
        home = _tracked(at_home[~at_home["floor"]])
        floor = named("floor", _retention(again, home))
        for world, away in kind[~kind["floor"]].groupby("deploy", sort=False):
            lines.append({**shared, "deploy": world, **_line(away, home), **floor})
    return pd.DataFrame(lines)


def agreement(episodes: pd.DataFrame, reference: str) -> pd.DataFrame:
    """How well each world predicts scores and ranks of policies in the reference world.

    One line per figure and world: Pearson's r of the policies' mean `tracked` with its interval,
    and `mmrv`. The line with `floor` compares the reference with itself from other initial states.
    """
    lines = []
    for key, kind in episodes.groupby(list(FIGURE), sort=False):
        means = kind.pivot_table("tracked", index="policy", columns=["deploy", "floor"])
        if (reference, False) in means.columns:
            for world, floor in dict.fromkeys(zip(kind["deploy"], kind["floor"], strict=True)):
                if (world == reference) == floor:
                    pair = means[[(world, floor), (reference, False)]].dropna()
                    compared = {"world": world, "floor": floor, **_agree(*pair.to_numpy().T)}
                    lines.append({**dict(zip(FIGURE, key, strict=True)), **compared})
    return pd.DataFrame(lines, columns=list(AGREEMENT))


def mmrv(scores: Array, reference: Array) -> float:
    """Mean maximum rank violation of N policies' scores against their reference scores.

    The mean over policies i of the largest |R_i - R_j| over the policies j that the scores S rank
    otherwise: (S_i < S_j) != (R_i < R_j). 0 where the ranking is the same; a wrong order counts by
    what it costs in the reference. From SIMPLER (Li et al., Evaluating Real-World Robot
    Manipulation Policies in Simulation, 2024).
    """
    violated = np.less.outer(scores, scores) != np.less.outer(reference, reference)
    cost = np.abs(np.subtract.outer(reference, reference))
    return float((violated * cost).max(axis=1).mean())


def _agree(scores: Array, reference: Array) -> dict[str, Any]:
    unknown = named("pearson", Estimate(value=np.nan, low=np.nan, high=np.nan))
    line: dict[str, Any] = {"policies": len(scores), **unknown, "mmrv": np.nan}
    if len(scores) < MIN_POLICIES:
        return line | {"note": f"{len(scores)} of at least {MIN_POLICIES} policies"}
    line |= {"mmrv": mmrv(scores, reference), "note": ""}
    if np.ptp(scores) == 0 or np.ptp(reference) == 0:
        return line | {"note": "all policies score alike"}
    found = stats.pearsonr(scores, reference)
    low, high = found.confidence_interval(LEVEL)
    return line | named("pearson", Estimate(value=found.statistic, low=low, high=high))


def _line(away: pd.DataFrame, home: pd.DataFrame) -> dict[str, Any]:
    """Scores in a deploy world, with the retention relative to the train world."""
    tracked = _tracked(away)
    many = len(tracked) >= MIN_SEEDS
    return {
        "seeds": away["seed"].nunique(),
        "episodes": tracked.shape[1],
        **named("tracked", bootstrap(mean, tracked.to_numpy())),
        **named("retention", _retention(tracked, home)),
        **{name: away[name].mean() for name in SCORES if name != "tracked"},
        "interval_over": SEEDS_TOO if many else EPISODES_ALONE,
    }


def _tracked(episodes: pd.DataFrame) -> pd.DataFrame:
    """`tracked` of S policies in E episodes, shape (S, E)."""
    return episodes.pivot(index="policy", columns="episode", values="tracked")


def _retention(away: pd.DataFrame, home: pd.DataFrame) -> Estimate:
    """Ratio of the means of the policies that have both; episodes are paired by number."""
    both = away.index.intersection(home.index)
    if both.empty or home.loc[both].to_numpy().mean() == 0:
        return Estimate(value=np.nan, low=np.nan, high=np.nan)
    return bootstrap(_ratio, away.loc[both].to_numpy(), home.loc[both].to_numpy())


def _ratio(top: Array, bottom: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return mean(top) / mean(bottom)


def bootstrap(statistic: Callable[..., Array], *scores: Array) -> Estimate:
    """A statistic of arrays (S, E) that are resampled together, and its interval or NaN."""
    index = _drawn(scores[0].shape)
    value = statistic(*(array.reshape(1, -1) for array in scores))[0]
    drawn = statistic(*(array.ravel()[index] for array in scores))
    low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    known = np.isfinite(drawn).all()
    return Estimate(value=value, low=low if known else np.nan, high=high if known else np.nan)


def _drawn(shape: tuple[int, ...]) -> Array:
    """Resampled indices of a flat (S, E) array: seeds, then episodes; episodes only for small S."""
    rng = np.random.default_rng(SEED)
    flat = np.arange(shape[0] * shape[1]).reshape(shape)
    strata = [flat] if shape[0] >= MIN_SEEDS else [row[None] for row in flat]
    return np.concatenate([resample(s, rng, REPLICATES).reshape(REPLICATES, -1) for s in strata], 1)


def named(name: str, found: Estimate) -> dict[str, float]:
    """An estimate as columns: its name alone, and with _low and _high."""
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
