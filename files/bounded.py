"""Read files that people wrote: of bounded size and depth, whole, and with an error of one line.

A device, a pipe or a file without end is refused before it is read. No other room is known here.
"""

import json
import stat
from itertools import islice
from pathlib import Path
from typing import Any

MOST_BYTES = 20_000_000
"""Largest file that is read as text or JSON."""
MOST_WORDS = 160
"""Characters of somebody else's text that a message repeats."""
LOOKED_AT, NAMED, NAMED_CHARACTERS = 1000, 4, 40
"""Of a folder so many files are looked at, and so many named, with so many characters."""


class FileError(ValueError):
    """A file cannot be read; the message names it, its fault and what is allowed."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """The file's contents; raises FileError, or FileNotFoundError where there is none."""
    try:
        kind = path.stat()
        if stat.S_ISDIR(kind.st_mode):
            raise FileError(f"{path} is a folder{_holding(path)}; give one file")
        if not stat.S_ISREG(kind.st_mode):
            raise FileError(f"{path} is no file with data, but a device; give a file")
        if kind.st_size > most:
            raise FileError(f"{path} has {kind.st_size} bytes; allowed: up to {most}")
        return path.read_bytes()
    except (FileNotFoundError, FileError):
        raise
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{one_line(str(path))} cannot be read: {what}") from error


def _holding(folder: Path) -> str:
    """What a folder holds, in a few words."""
    found = islice((one.name for one in folder.iterdir()), LOOKED_AT)
    names = sorted(one_line(name, NAMED_CHARACTERS) for name in found)
    more = ", ..." if len(names) > NAMED else ""
    return f" that holds {', '.join(names[:NAMED])}{more}" if names else ""


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """The file's text, UTF-8 with or without its mark; raises as `read_bytes` does."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path} cannot be read as UTF-8 text: {error}; save it as UTF-8") from None


def read_json(path: Path, most: int = MOST_BYTES) -> dict[str, Any]:
    """The file's JSON object; raises as `read_bytes` does."""
    try:
        data = json.loads(read_text(path, most))
    except FileError:
        raise
    except ValueError as error:
        raise FileError(f"{path} cannot be read as JSON: {one_line(str(error))}") from None
    except RecursionError:
        raise FileError(f"{path} cannot be read as JSON: it is nested too deeply") from None
    if not isinstance(data, dict):
        raise FileError(f"{path} holds no JSON object")
    return data


def one_line(text: str, most: int = MOST_WORDS) -> str:
    """A text on one line, of bounded length."""
    line = " ".join(text.split())
    return line if len(line) <= most else f"{line[:most]} ..."
