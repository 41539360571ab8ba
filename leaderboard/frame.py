"""The leaderboard as a table."""

from pathlib import Path

import pandas as pd

from leaderboard.rows import read_rows
from leaderboard.tables import board


def leaderboard(*sources: Path | str, include_smoke: bool = False) -> pd.DataFrame:
    """One line per policy and task: scores with their intervals, seeds and rank.

    `sources` are run folders, folders of them, or of kept rows. Raises ValueError for what cannot
    be read, and where there is nothing to rank.
    """
    rows, problems = read_rows(sources)
    if problems:
        raise ValueError("; ".join(problems))
    found = board(rows, smoke=include_smoke).frame
    if found.empty:
        left = f"{len(rows)} smoke runs; include_smoke=True shows them" if rows else "no run"
        raise ValueError(f"nothing to rank: {left}")
    return found
