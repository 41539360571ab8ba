"""The files of a transfer matrix, each written completely or not at all."""

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from files.bounded import read_json
from files.tables import csv_text, read_parquet
from leaderboard._heatmap import draw_heatmap
from leaderboard._whole import write_all
from leaderboard.transfer import agreement, matrix
from leaderboard.transfer_text import markdown

EPISODES_FILE, ABOUT_FILE = "episodes.parquet", "about.json"
"""Scores of every episode, and what else is known: all other files are made from these two."""


def write_transfer(
    episodes: pd.DataFrame, reference: str, notes: Sequence[str], folder: Path
) -> list[Path]:
    """Write episodes, matrix, rank agreement, Markdown and heat map into a folder; the files.

    `reference` names the world that stands in for reality, `notes` say what is missing and why.
    """
    about = json.dumps({"reference": reference, "notes": list(notes)}, indent=2) + "\n"
    sources = {
        EPISODES_FILE: _bytes(lambda file: episodes.to_parquet(file, index=False)),
        ABOUT_FILE: about.encode(),
    }
    return write_all({**sources, **derived(episodes, reference, notes)}, folder)


def derived(episodes: pd.DataFrame, reference: str, notes: Sequence[str]) -> dict[str, bytes]:
    """What follows from the episodes, by file name."""
    table, agrees = matrix(episodes), agreement(episodes, reference)
    return {
        "matrix.parquet": _bytes(lambda file: table.to_parquet(file, index=False)),
        "matrix.csv": _csv(table),
        "agreement.csv": _csv(agrees),
        "transfer.md": markdown(table, agrees, reference, notes).encode(),
        "heatmap.png": _bytes(lambda file: draw_heatmap(table, file)),
    }


def read_sources(folder: Path) -> tuple[pd.DataFrame, str, list[str]]:
    """Episodes, reference and notes of a folder that `write_transfer` wrote."""
    about = read_json(folder / ABOUT_FILE)
    return read_parquet(folder / EPISODES_FILE), about["reference"], about["notes"]


def _csv(table: pd.DataFrame) -> bytes:
    return csv_text(table, float_format="%.6g").encode()


def _bytes(write: Callable[[io.BytesIO], object]) -> bytes:
    file = io.BytesIO()
    write(file)
    return file.getvalue()
