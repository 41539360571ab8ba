"""One file of a recording as people write it: separators, decimal commas, units in a second line.

Reads CSV files, and parquet files such as those of LeRobot, whose lists become columns with the
names that `meta/info.json` gives them.
"""

import codecs
import csv
import io
import re
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._meta import LogError, as_log_errors
from diagnosis.logs.ros import is_bag, read_bag
from files import bounded, tables
from files.bounded import FileError

BLANKS = r"\s+"
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", BLANKS: "blanks"}
"""What stands between cells, and how it is said; blanks where there is nothing else."""
COMMA = re.compile(r"^[-+]?\d*,\d+([eE][-+]?\d+)?$")
COMMENT = re.compile(r"^\s*(?:[#%]+\s*|sep=)")
VALUE = re.compile(r"^(?:[-+.]?\d|nan$|inf$|-inf$)", re.IGNORECASE)
"""How a cell begins that is no name and no unit."""
NAMELESS = r"Unnamed: \d+$"
"""What pandas calls a column without a name, such as the numbers of rows."""
LIST = re.compile(r"\[[-+\d.eE,\s]+\]")
"""What a list of numbers is, as text."""
LISTS = list, tuple, np.ndarray
NUMBERED, NAMED = re.compile(r"(.*\D)(\d+)"), re.compile(r"(?:^|[._])(?:joint_)?names?$")
"""Entries of lists in columns of their own, and what such columns are called that name joints."""
NAMES = "joint_list.txt"
"""A file beside a table that names the entries of its lists, a line each, as SAGE writes it."""
MOST_LISTED = 200
"""Longest list in a cell that becomes columns."""
LINE = re.compile(rb"[^\r\n]+")
HEAD = 1000
"""Names and the first numbers stand in so many lines."""
LOOKED_AT = 50
"""Lines by which the form of the numbers is known."""
OTHERS = {
    b"{": "JSON; save its rows as CSV, a column per joint and signal",
    b"PK\x03\x04": "a spreadsheet or an archive; save the table as CSV",
    b"\x89HDF": "an HDF5 file; save its arrays as CSV or parquet, a column each",
    b"MATLAB": "a MATLAB file; save its arrays as CSV, such as with writetable",
    b"\x93NUMPY": "a NumPy file; save it as CSV, with the columns' names in the first line",
}
"""How files begin that are no tables, and what to do with them."""


def read_table(path: Path) -> tuple[pd.DataFrame, str]:
    """A table and the form it has, in words; raises LogError."""
    if is_bag(path):
        return read_bag(path)
    try:
        with as_log_errors():
            if path.suffix == ".parquet":
                frame, form = tables.read_parquet(path), "parquet"
            else:
                frame, form = _csv(path, _in_utf8(path))
    except FileNotFoundError:
        raise LogError(f"no file {path}; give the table of the recording") from None
    if not len(frame):
        raise LogError(f"{path} has no rows; it should hold a header and a row per sample")
    return _by_joint(_expanded(path, frame)), form


def _in_utf8(path: Path) -> bytes:
    """The text of a file in UTF-8, UTF-16, or else in what Windows writes; raises as `bounded`."""
    data = bounded.read_bytes(path, tables.MOST_BYTES)
    for start, said in OTHERS.items():
        if data.startswith(start):
            raise LogError(f"{path} is {said}")
    wide = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in ("utf-16",) if wide else ("utf-8", "cp1252"):
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            if "\0" not in text:
                plain = data if encoding == "utf-8" else text.encode()
                return plain.removeprefix(codecs.BOM_UTF8)
    raise LogError(f"{path} is no text; give a table as CSV or parquet")


def _csv(path: Path, data: bytes) -> tuple[pd.DataFrame, str]:
    head = list(islice((line for line in LINE.finditer(data) if line[0].strip()), HEAD))
    lines = [line[0].decode() for line in head]
    first = next((n for n, line in enumerate(lines) if not COMMENT.match(line)), len(lines))
    if len(lines) < first + 2:
        return pd.DataFrame(), "CSV"
    separator = max(SEPARATORS, key=lines[first].count)
    separator = separator if separator in lines[first] else BLANKS
    names, begins = _names(path, lines, first, separator)
    cells = [cell for line in lines[begins:][:LOOKED_AT] for cell in _cells(line, separator)]
    decimal = "," if separator != "," and any(COMMA.match(cell) for cell in cells) else "."
    rows = memoryview(data)[head[begins].start() :] if begins < len(head) else b""
    body = b"\n".join((_line(names, separator).encode(), rows, b""))
    frame = tables.parse_csv(path, body, sep=separator, decimal=decimal, skipinitialspace=True)
    frame.columns = [str(name).strip() for name in frame.columns]
    said = f"CSV between {SEPARATORS[separator]}"
    named = frame.loc[:, ~frame.columns.str.match(NAMELESS)]
    return named, said + (", with decimal commas" if decimal == "," else "")


def _names(path: Path, lines: Sequence[str], first: int, separator: str) -> tuple[list[str], int]:
    """The names of the columns, and the line with which their values begin; raises LogError.

    A comment may hold the names, a second line units or the rest of the names.
    """
    names, begins = _cells(lines[first], separator), first + 1
    if VALUE.match(names[0] if names else ""):
        last = COMMENT.sub("", lines[first - 1]) if first else ""
        every = (_cells(last, one) for one in (separator, *SEPARATORS))
        said = next((one for one in every if len(one) == len(names)), None)
        if said is not None:
            return said, first
    said_names = [name for name in names if name]
    if 2 * sum(bool(VALUE.match(name)) for name in said_names) > len(said_names) > 0:
        raise LogError(
            f"the first line of {path} holds numbers; write the names of its columns there"
        )
    cells = _cells(lines[begins], separator)
    if len(cells) == len(names) and any(cells) and not any(map(VALUE.match, cells)):
        for k, cell in enumerate(cells):
            names[k] = names[k] or (names[k - 1].rpartition(" ")[0] if k and cell else "")
            names[k] = f"{names[k]} {cell}".strip()
        begins += 1
    extra = len(_cells(lines[begins], separator)) - len(names) if begins < len(lines) else 0
    if extra > 0:  # a bare number of the row, or separators at the end of lines
        ends = not any(_cells(lines[begins], separator)[-extra:])
        names = [*names, *[""] * extra] if ends else [*[""] * extra, *names]
    return names, begins


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a line."""
    if separator == BLANKS:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _line(cells: Sequence[str], separator: str) -> str:
    """A line of cells, as `_cells` reads it."""
    if separator == BLANKS:
        return " ".join(cell.replace(" ", "_") for cell in cells)
    text = io.StringIO()
    csv.writer(text, delimiter=separator, lineterminator="").writerow(cells)
    return text.getvalue()


def _expanded(path: Path, frame: pd.DataFrame) -> pd.DataFrame:
    """The table with a column per entry of lists, which may be texts such as '[0.1, 0.2]'."""
    first = {name: frame[name].iloc[0] for name in frame}
    texts = {n for n, cell in first.items() if isinstance(cell, str) and LIST.fullmatch(cell)}
    lists = texts | {name for name, cell in first.items() if isinstance(cell, LISTS)}
    if not lists:
        return frame
    names, beside = _feature_names(path), list[str]()
    with suppress(FileNotFoundError, FileError):
        beside = bounded.read_text(path.parent / NAMES).split()
    found: dict[str, np.ndarray] = {}
    for column in frame.columns:
        if column not in lists:
            found[column] = frame[column].to_numpy()
            continue
        if column in texts:
            rows = [np.fromstring(str(cell).strip("[]"), sep=",") for cell in frame[column]]
        else:
            rows = [np.asarray(cell, dtype=float).ravel() for cell in frame[column]]
        if len({len(row) for row in rows}) > 1 or len(rows[0]) > MOST_LISTED:
            continue
        usual = beside if len(beside) == len(rows[0]) else [str(k) for k in range(len(rows[0]))]
        entries = names.get(column, usual)
        for name, values in zip(entries, np.stack(rows).T, strict=False):
            found[f"{column}.{name}"] = values
    return pd.DataFrame(found)


def _by_joint(frame: pd.DataFrame) -> pd.DataFrame:
    """The table with joints' names for numbers in those of its columns.

    Where columns such as 'joint_names0' hold a name each, as ROS writes messages in cells.
    """
    listed = {name: NUMBERED.fullmatch(str(name)) for name in frame}
    said = {
        match[2]: str(frame[name].iloc[0])
        for name, match in listed.items()
        if match and NAMED.search(match[1]) and frame[name].nunique() == 1
    }
    kept = [n for n, match in listed.items() if not (match and NAMED.search(match[1]))]
    if len(said) < 2 or len(set(said.values())) < len(said):
        return frame
    found = frame[kept]
    found.columns = [
        f"{match[1]}.{said[match[2]]}" if (match := listed[n]) and match[2] in said else n
        for n in kept
    ]
    return found


def _feature_names(path: Path) -> dict[str, list[str]]:
    """What the entries of lists are called, by column, as a LeRobot data set says beside it."""
    folders = [path.parent, *path.parents][:5]
    there = (info for folder in folders if (info := folder / "meta" / "info.json").is_file())
    try:
        features = bounded.read_json(next(there)).get("features", {})
    except (StopIteration, FileError, AttributeError):
        return {}
    named = {column: one.get("names") for column, one in features.items()}
    lists = {k: next(iter(v.values())) if isinstance(v, dict) else v for k, v in named.items() if v}
    return {column: [str(name) for name in names] for column, names in lists.items()}
