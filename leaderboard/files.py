"""The leaderboard's files, each written whole or not at all."""

import os
from pathlib import Path

from leaderboard._markdown import markdown
from leaderboard._matrices import MATRIX_FILE
from leaderboard._page import page
from leaderboard.tables import Board

CSV_FILE, MARKDOWN_FILE, HTML_FILE = "leaderboard.csv", "leaderboard.md", "leaderboard.html"
PICTURES = "figures"
"""Folder beside the files; the page shows the PNG files in it."""
TRANSFERS = "transfer"
"""Folder beside the files; the page shows the transfer matrices in its folders."""


def write(board: Board, folder: Path, html: bool = True) -> list[Path]:
    """Write CSV, Markdown and, unless told otherwise, the page into a folder; the files."""
    texts = {
        CSV_FILE: board.frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"),
        MARKDOWN_FILE: markdown(board),
    }
    if html:
        pictures = sorted((folder / PICTURES).glob("*.png"))
        texts[HTML_FILE] = page(board, pictures, _transfers(folder))
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        _write(folder / name, text)
    return [folder / name for name in texts]


def _transfers(folder: Path) -> list[Path]:
    return sorted(file.parent for file in (folder / TRANSFERS).glob(f"*/{MATRIX_FILE}"))


def _write(path: Path, text: str) -> None:
    """Write the whole file or none of it: to a neighbour, then renamed."""
    neighbour = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        neighbour.write_text(text, encoding="utf-8", newline="\n")
        os.replace(neighbour, path)
    finally:
        neighbour.unlink(missing_ok=True)
