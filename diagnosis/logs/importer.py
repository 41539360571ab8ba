"""Importers: convert published recordings into the log format, with their mechanism."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from diagnosis.logs.log import DriveSettings, Log, LogError, LogMeta, MjcfMechanism, make_log

MOST_BYTES = 100_000_000
"""Largest recording that is read."""


class Importer(ABC):
    """Base class of every importer; a subclass named `Importer` in its own file is one importer."""

    @abstractmethod
    def read(self, path: Path) -> dict[str, Log]:
        """The logs in a file or folder, by name; raises LogError if they are not of this kind."""


def log_of(
    source: str,
    samples: pd.DataFrame,
    mjcf: tuple[str, str],
    drives: Mapping[str, DriveSettings],
    unused: Iterable[str],
    **meta: Any,
) -> Log:
    """A log with its mechanism, a file's name and text, that says which columns it does not use."""
    mechanism = MjcfMechanism(mjcf=mjcf[0], joints=dict(drives))
    log = make_log(LogMeta(schema=1, source=source, mechanism=mechanism, **meta), samples, mjcf[1])
    names = ", ".join(dict.fromkeys(unused))
    return replace(log, said=(f"not used: {names}",)) if names else log


def files(path: Path, pattern: str) -> list[Path]:
    """`path` itself, or the files in it that match; raises LogError if there are none."""
    if path.is_file():
        return [path]
    found = sorted(path.glob(pattern)) if path.is_dir() else []
    if not found:
        raise LogError(f"no recording at {path}; give a {pattern} file or a folder with such files")
    return found
