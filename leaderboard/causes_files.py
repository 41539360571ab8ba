"""The files that say what makes the losses of a transfer matrix."""

import io
import json
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from files.bounded import read_json
from files.tables import csv_text, read_parquet
from leaderboard._causes_chart import draw_causes
from leaderboard._whole import write_all
from leaderboard.causes import causes
from leaderboard.causes_text import markdown
from leaderboard.transfer_files import ABOUT_FILE

CAUSES_FILE = "causes.parquet"
"""Scores of every episode: with `about.json` all other files are made from it."""


def write_causes(
    episodes: pd.DataFrame, reference: str, notes: Sequence[str], folder: Path
) -> list[Path]:
    """Write episodes, table, Markdown and picture into a folder; the files.

    `reference` names the world that stands in for reality, `notes` say what is missing and why.
    """
    about = json.dumps({"reference": reference, "notes": list(notes)}, indent=2) + "\n"
    file = io.BytesIO()
    episodes.to_parquet(file, index=False)
    sources = {CAUSES_FILE: file.getvalue(), ABOUT_FILE: about.encode()}
    return write_all({**sources, **derived(episodes, notes)}, folder)


def derived(episodes: pd.DataFrame, notes: Sequence[str]) -> dict[str, bytes]:
    """What follows from the episodes, by file name."""
    lines = causes(episodes)
    picture = io.BytesIO()
    draw_causes(lines, picture)
    return {
        "causes.csv": csv_text(lines, float_format="%.6g").encode(),
        "causes.md": markdown(lines, notes).encode(),
        "causes.png": picture.getvalue(),
    }


def read_causes(folder: Path) -> tuple[pd.DataFrame, list[str]]:
    """Episodes and notes of a folder that `write_causes` wrote."""
    return read_parquet(folder / CAUSES_FILE), read_json(folder / ABOUT_FILE)["notes"]
