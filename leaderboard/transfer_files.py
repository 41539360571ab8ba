"""The files of a transfer matrix, each written whole or not at all."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from leaderboard._heatmap import draw_heatmap
from leaderboard.transfer import agreement, matrix
from leaderboard.transfer_text import markdown

EPISODES_FILE = "episodes.parquet"
"""Scores of every episode: all other files are made from it."""


def write_transfer(
    episodes: pd.DataFrame, reference: str, notes: Sequence[str], folder: Path
) -> list[Path]:
    """Write episodes, matrix, rank agreement, Markdown and heat map into a folder; the files.

    `reference` names the world that stands in for reality, `notes` say what is missing and why.
    """
    table, agrees = matrix(episodes), agreement(episodes, reference)
    text = markdown(table, agrees, reference, notes)
    writers: dict[str, Callable[[Path], object]] = {
        EPISODES_FILE: lambda path: episodes.to_parquet(path, index=False),
        "matrix.parquet": lambda path: table.to_parquet(path, index=False),
        "matrix.csv": lambda path: _csv(table, path),
        "agreement.csv": lambda path: _csv(agrees, path),
        "transfer.md": lambda path: path.write_text(text, encoding="utf-8", newline="\n"),
        "heatmap.png": lambda path: draw_heatmap(table, path),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, write in writers.items():
        _write(folder / name, write)
    return [folder / name for name in writers]


def _csv(table: pd.DataFrame, path: Path) -> None:
    table.to_csv(path, index=False, float_format="%.6g", lineterminator="\n")


def _write(path: Path, write: Callable[[Path], object]) -> None:
    """Write to a neighbour, then rename."""
    neighbour = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(neighbour)
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
