"""Transfer matrices for the page, from the files of `bench transfer`."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from files.tables import read_csv
from leaderboard import transfer_text as text

MATRIX_FILE, AGREEMENT_FILE = "matrix.csv", "agreement.csv"


def matrices(folders: Iterable[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """The page's sections about each folder, and why other folders cannot be shown."""
    shown, broken = [], []
    for folder in folders:
        try:
            shown.append(_section(folder))
        except (OSError, KeyError, ValueError, TypeError) as error:
            broken.append(
                f"{folder.name}: cannot be shown ({error}); allowed: a folder of `bench transfer`"
            )
    return shown, broken


def _section(folder: Path) -> dict[str, Any]:
    matrix = read_csv(folder / MATRIX_FILE)
    agreement = read_csv(folder / AGREEMENT_FILE).fillna({"note": ""})
    return {
        "name": folder.name.replace("-", " "),
        "panels": [
            {
                "title": text.title(panel.shared),
                "scores": text.cells(panel),
                "errors": text.error_cells(panel),
                "counts": text.counts(panel),
            }
            for panel in text.panels(matrix)
        ],
        "agreement": text.agreement_cells(agreement) if len(agreement) else None,
    }
