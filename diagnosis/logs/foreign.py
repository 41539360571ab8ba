"""A table as people write it: commas, semicolons or tabs, decimal commas, lists in cells.

Reads CSV files, and parquet files such as those of LeRobot, whose lists become columns with the
names that `meta/info.json` gives them.
"""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._meta import LogError
from diagnosis.logs.ros import is_bag, read_bag
from files import bounded, tables
from files.bounded import FileError

SEPARATORS = (";", "\t", ",", "|")
COMMA = re.compile(r"^[-+]?\d*,\d+([eE][-+]?\d+)?$")
NAMELESS = r"Unnamed: \d+$"
"""What pandas calls a column without a name, such as the numbers of rows."""
MOST_LISTED = 200
"""Longest list in a cell that becomes columns."""
LOOKED_AT = 50
"""Lines by which the form of the numbers is known."""


def read_table(path: Path) -> tuple[pd.DataFrame, str]:
    """A table and the form it has, in words; raises LogError."""
    if is_bag(path):
        return read_bag(path)
    try:
        if path.suffix == ".parquet":
            return _expanded(path, tables.read_parquet(path)), "parquet"
        return _csv(path, bounded.read_text(path, tables.MOST_BYTES))
    except FileNotFoundError:
        raise LogError(f"no file {path}; give the table of the recording") from None
    except FileError as error:
        raise LogError(str(error)) from None


def _csv(path: Path, text: str) -> tuple[pd.DataFrame, str]:
    lines = text.splitlines()
    skipped = 0
    while skipped < len(lines) and (not lines[skipped].strip() or lines[skipped][0] in "#%"):
        skipped += 1
    if len(lines) < skipped + 2:
        raise LogError(f"{path} has no rows; it should hold a header and a row per sample")
    header = lines[skipped]
    separator = max(SEPARATORS, key=header.count)
    cells = [
        cell
        for row in csv.reader(lines[skipped + 1 :][:LOOKED_AT], delimiter=separator)
        for cell in row
    ]
    decimal = "," if separator != "," and any(COMMA.match(cell.strip()) for cell in cells) else "."
    body = "\n".join(lines[skipped:]) + "\n"
    frame = tables.parse_csv(path, body, sep=separator, decimal=decimal, skipinitialspace=True)
    frame.columns = [str(name).strip() for name in frame.columns]
    frame = frame.loc[:, ~frame.columns.str.match(NAMELESS)]
    named = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars"}[separator]
    return frame, f"CSV between {named}" + (", with decimal commas" if decimal == "," else "")


def _expanded(path: Path, frame: pd.DataFrame) -> pd.DataFrame:
    """The table with a column per entry of lists."""
    names = _feature_names(path)
    found: dict[str, np.ndarray] = {}
    for column in frame.columns:
        first = frame[column].iloc[0] if len(frame) else None
        if not isinstance(first, list | tuple | np.ndarray):
            found[column] = frame[column].to_numpy()
            continue
        rows = [np.asarray(cell, dtype=float).ravel() for cell in frame[column]]
        if len({len(row) for row in rows}) > 1 or len(rows[0]) > MOST_LISTED:
            continue
        entries = names.get(column, [str(k) for k in range(len(rows[0]))])
        for name, values in zip(entries, np.stack(rows).T, strict=False):
            found[f"{column}.{name}"] = values
    return pd.DataFrame(found)


def _feature_names(path: Path) -> dict[str, list[str]]:
    """What the entries of lists are called, by column, as a LeRobot data set says beside it."""
    for folder in [path.parent, *path.parents][:5]:
        info = folder / "meta" / "info.json"
        if not info.is_file():
            continue
        try:
            features = bounded.read_json(info).get("features", {})
        except (FileError, AttributeError, json.JSONDecodeError):
            return {}
        named = {column: one.get("names") for column, one in features.items()}
        return {
            column: [
                str(n) for n in (next(iter(names.values())) if isinstance(names, dict) else names)
            ]
            for column, names in named.items()
            if names
        }
    return {}
