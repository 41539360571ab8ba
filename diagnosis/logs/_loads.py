"""Check the loads of a log: a push that nobody knows, or a pull that no hand holds against."""

import numpy as np
import pandas as pd

from diagnosis.logs._columns import PULL
from diagnosis.logs._meta import LogError, LogMeta

STRONGEST_N = 1000.0
"""Largest plausible pull."""
INWARDS = 0.1
"""Share of the largest pull by which noise may push the stick into the hand."""


def check(meta: LogMeta, samples: pd.DataFrame) -> None:
    """Raise LogError for a load that is not known or cannot be."""
    if PULL in samples:
        _check_pull(samples[PULL].to_numpy())
    pushed = {e.episode for e in meta.episodes if e.protocol == "push"}
    for number, part in samples.groupby("episode", sort=False):
        if int(str(number)) in pushed:
            _check_pushes(int(str(number)), part)


def _check_pull(pull_n: np.ndarray) -> None:
    low, high = np.nanmin(pull_n, initial=0.0), np.nanmax(pull_n, initial=0.0)
    if high > STRONGEST_N:
        raise LogError(
            f"'{PULL}' reaches {high:.4g} N; allowed: up to {STRONGEST_N:g} N; convert mN, grams "
            "or counts first"
        )
    if low < -INWARDS * high - 1e-9:
        raise LogError(
            f"'{PULL}' goes down to {low:.4g} N; forces towards the stick's lower end, out of the "
            "hand, must be positive; change the sign"
        )


def _check_pushes(number: int, part: pd.DataFrame) -> None:
    """Refuse an episode with an unknown push: it could look like any effect."""
    pushes = part[[name for name in part if str(name).startswith("push_")]]
    if not pushes.notna().to_numpy().any():
        raise LogError(
            f"episode {number} is of protocol 'push' and has no channel 'push', so the push is "
            "unknown; log it, for example as 'push_nm.JOINT', or leave the episode out"
        )
