"""Details of a kept row besides its means: scores per episode and the learning curve.

A run folder has them in `episodes.parquet` and `progress.csv`. A kept row contains them, so that
intervals and curves can be made without the run folder.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from files.bounded import one_line
from files.tables import read_csv, read_parquet
from leaderboard.curves import CURVE, thin

EPISODES_FILE, PROGRESS_FILE = "episodes.parquet", "progress.csv"
SCORES = ("tracked", "held", "p_err_cm", "q_err_deg")
POINTS = 50
"""Points of a kept learning curve."""


class DetailsError(ValueError):
    """A file next to run.json cannot be read; the message is complete."""


def read_details(folder: Path) -> dict[str, dict[str, list]]:
    """`episodes` and `curve` of a run folder, each only if its file exists.

    They are rounded to six and four digits, as in a kept row. Raises DetailsError.
    """
    details: dict[str, dict[str, list]] = {}
    if (folder / EPISODES_FILE).exists():
        scores = _read(folder / EPISODES_FILE, read_parquet, SCORES)
        details["episodes"] = {name: rounded(scores[name], 6) for name in SCORES}
    if (folder / PROGRESS_FILE).exists():
        progress = _read(folder / PROGRESS_FILE, read_csv, ("steps", *CURVE))
        curve = thin(progress, POINTS)
        steps = [int(step) for step in curve.pop("steps")]
        details["curve"] = {"steps": steps, **{k: rounded(v, 4) for k, v in curve.items()}}
    return details


def rounded(values: Iterable[float], digits: int) -> list[float]:
    """Round plain numbers to significant digits."""
    return [float(f"{value:.{digits}g}") for value in values]


def kept_text(row: dict, details: Mapping[str, dict[str, list]]) -> str:
    """A row with its details as JSON text, every list on one line."""
    text = json.dumps(row, indent=2).removesuffix("\n}")
    for name, lists in details.items():
        lines = ",\n".join(f'    "{key}": {json.dumps(values)}' for key, values in lists.items())
        text += f',\n  "{name}": {{\n{lines}\n  }}'
    return text + "\n}\n"


def _read(path: Path, read: Callable[[Path], pd.DataFrame], columns: tuple[str, ...]) -> Any:
    try:
        found = read(path)[list(columns)].astype(float)
        if not np.isfinite(found.to_numpy()).all():
            raise ValueError("it has values that are no finite numbers")
        return found
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = one_line(str(error))
        raise DetailsError(
            f"{path}: cannot be used ({reason}); its row has no such details"
        ) from error
