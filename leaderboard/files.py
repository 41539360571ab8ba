"""The leaderboard's files, each written whole or not at all."""

from pathlib import Path

from files.tables import csv_text
from leaderboard._markdown import markdown
from leaderboard._matrices import MATRIX_FILE
from leaderboard._page import page
from leaderboard._whole import write_all
from leaderboard.tables import Board

CSV_FILE, MARKDOWN_FILE, HTML_FILE = "leaderboard.csv", "leaderboard.md", "leaderboard.html"
PICTURES = "figures"
"""Folder beside the files; the page shows the PNG files in it."""
TRANSFERS = "transfer"
"""Folder beside the files; the page shows the transfer matrices in its folders."""


def write(board: Board, folder: Path, html: bool = True) -> list[Path]:
    """Write CSV, Markdown and, unless asked otherwise, the page into a folder; the files."""
    return write_all(contents(board, folder, html), folder)


def contents(board: Board, folder: Path, html: bool = True) -> dict[str, bytes]:
    """What `write` writes, by file name; the page shows what lies in the folder."""
    texts = {
        CSV_FILE: csv_text(board.frame, float_format="%.6g"),
        MARKDOWN_FILE: markdown(board),
    }
    if html:
        pictures = sorted((folder / PICTURES).glob("*.png"))
        texts[HTML_FILE] = page(board, pictures, transfer_folders(folder))
    return {name: text.encode() for name, text in texts.items()}


def transfer_folders(folder: Path) -> list[Path]:
    """The folders of transfer matrices beside a leaderboard's files."""
    return sorted(file.parent for file in (folder / TRANSFERS).glob(f"*/{MATRIX_FILE}"))
