"""Importers: convert published recordings into the log format, with their mechanism."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from diagnosis.logs.log import Log, LogError

MOST_BYTES = 100_000_000
"""Largest recording that is read."""


class Importer(ABC):
    """Base class of every importer; a subclass named `Importer` in its own file is one importer."""

    @abstractmethod
    def read(self, path: Path) -> dict[str, Log]:
        """The logs in a file or folder, by name; raises LogError if they are not of this kind."""


def with_unused(log: Log, columns: Iterable[str]) -> Log:
    """A log that says which columns of its recording it does not use."""
    names = ", ".join(dict.fromkeys(columns))
    return replace(log, said=(*log.said, f"not used: {names}")) if names else log


def files(path: Path, pattern: str) -> list[Path]:
    """`path` itself, or the files in it that match; raises LogError if there are none."""
    if path.is_file():
        return [path]
    found = sorted(path.glob(pattern)) if path.is_dir() else []
    if not found:
        raise LogError(f"no recording at {path}; give a {pattern} file or a folder with such files")
    return found
