"""Logs: the commands and readings of a mechanism, in the same columns for engines and robots.

A log is a folder: `log.yaml` (`LogMeta`) and `samples.parquet` or `samples.csv`, a row per sample.
Row k of an episode holds the readings at `t_s[k]` and the command and push that act from there to
the next row. Episodes start at rest. The format is described in docs/reference/log-format.md.
"""

import dataclasses
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from diagnosis.logs import _checks, _files
from diagnosis.logs._columns import KINDS, PULL, STICK, kind_of, name_of
from diagnosis.logs._files import check_target as check_target
from diagnosis.logs._meta import Channel as Channel
from diagnosis.logs._meta import DriveSettings as DriveSettings
from diagnosis.logs._meta import EpisodeMeta, LogError, LogMeta
from diagnosis.logs._meta import HandMechanism as HandMechanism
from diagnosis.logs._meta import MjcfMechanism as MjcfMechanism
from diagnosis.logs._meta import as_log_errors as as_log_errors
from diagnosis.logs._meta import drive_of as drive_of
from diagnosis.logs.stamps import Notes
from diagnosis.logs.whole_rows import without_empty_cells, without_missing_rows

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Log:
    """A checked log: made by `make_log` or `read_log`."""

    meta: LogMeta
    samples: pd.DataFrame
    """A row per sample, columns as in docs/reference/log-format.md.

    `touch.<finger>` holds arrays or None.
    """
    mjcf_xml: str | None = None
    """Text of the mechanism's MJCF file; None for a hand that is known by name."""
    warnings: tuple[str, ...] = ()
    """Warnings from reading: what is unusual but usable."""
    said: tuple[str, ...] = ()
    """What was understood of a user's tables, a line each."""

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the commanded joints, in the order of the columns."""
        found = (kind_of(column) for column in self.samples.columns)
        return tuple(pair[1] for pair in found if pair and pair[0] == "command")

    @cached_property
    def fingers(self) -> tuple[str, ...]:
        """Names of the fingers with touch columns."""
        names = self.samples.columns
        return tuple(n.split(".", 1)[1] for n in names if n.startswith("touch."))

    @property
    def is_binary(self) -> bool:
        """Whether taxels say contact or none, and no depth."""
        touch = self.meta.channels.get("touch")
        return touch is not None and touch.unit == "1"

    @property
    def episodes(self) -> tuple[EpisodeMeta, ...]:
        """The episodes with their protocols, in order."""
        return self.meta.episodes

    def is_linear(self, joint: str) -> bool:
        """Whether a joint is a slide, with columns in metres and newtons."""
        return name_of("command", joint, linear=True) in self.samples.columns

    def column(self, kind: str, joint: str) -> str:
        """Column name of a kind, one of `KINDS`; raises LogError if there is no such column."""
        if kind not in KINDS:
            raise LogError(f"no kind of column '{kind}'; known: {', '.join(KINDS)}")
        name = name_of(kind, joint, self.is_linear(joint))
        if name not in self.samples.columns:
            raise LogError(f"this log has no '{name}'; it has: {', '.join(self.samples.columns)}")
        return name

    def has(self, kind: str, joint: str) -> bool:
        """Whether a kind was logged for a joint in any episode."""
        return name_of(kind, joint, self.is_linear(joint)) in self.samples.columns

    def episode(self, number: int) -> pd.DataFrame:
        """The samples of one episode, indexed from 0; raises LogError if it does not exist."""
        if number not in self._parts:
            known = ", ".join(str(e.episode) for e in self.episodes)
            raise LogError(f"this log has no episode {number}; it has: {known}")
        return self._parts[number]

    def signal(self, kind: str, episode: int, joints: Sequence[str] | None = None) -> Array:
        """A kind for all joints or some, shape (T, J); NaN where it was not logged."""
        return signal(self, self.episode(episode), kind, self.joints if joints is None else joints)

    def touch(self, episode: int) -> Array | None:
        """Readings of all taxels, shape (T, F, 128); None if the episode has none."""
        frame = self.episode(episode)
        columns = [frame[f"touch.{finger}"] for finger in self.fingers]
        if not columns or any(column.isna().any() for column in columns):
            return None
        return np.stack([np.stack(list(column)) for column in columns], axis=1)

    def stick(self, episode: int) -> Array | None:
        """Stick pose x y z [m], qw qx qy qz, shape (T, 7); None if the episode has none."""
        return self._whole(episode, STICK)

    def pull(self, episode: int) -> Array | None:
        """Known force on the stick towards its lower end [N], shape (T,); None if there is none."""
        force = self._whole(episode, [PULL])
        return None if force is None else force[:, 0]

    def dt_s(self, episode: int) -> float:
        """Sample period: the median of an episode's time steps [s]."""
        return float(np.median(np.diff(self.episode(episode)["t_s"])))

    def _whole(self, episode: int, columns: Sequence[str]) -> Array | None:
        """Columns of an episode, shape (T, C); None if any of it is missing."""
        frame = self.episode(episode)
        if not set(columns) <= set(frame):
            return None
        values = frame[list(columns)].to_numpy(dtype=float)
        return None if np.isnan(values).any() else values

    @cached_property
    def _parts(self) -> dict[int, pd.DataFrame]:
        number = self.samples["episode"].to_numpy()
        edges = pairwise(np.flatnonzero(np.diff(number, prepend=-1, append=-1)))
        return {int(number[a]): self.samples.iloc[a:b].reset_index(drop=True) for a, b in edges}


def signal(log: Log, rows: pd.DataFrame, kind: str, joints: Sequence[str]) -> Array:
    """A kind for some joints in rows of a log, shape (T, J); NaN where it was not logged."""
    names = [name_of(kind, joint, log.is_linear(joint)) for joint in joints]
    none = np.full(len(rows), np.nan)
    columns = (rows[n].to_numpy(dtype=float) if n in rows else none for n in names)
    return np.stack(list(columns), axis=1)


def make_log(meta: LogMeta, samples: pd.DataFrame, mjcf_xml: str | None = None) -> Log:
    """Make a log from its parts and fill in all optional parts; raises LogError."""
    meta, samples, warnings = _checks.check(meta, samples)
    return Log(meta=meta, samples=samples, mjcf_xml=mjcf_xml, warnings=warnings)


def read_log(path: Path | str) -> Log:
    """Read and check the log in a folder; raises LogError with the fault and what to do."""
    notes = Notes()
    meta, samples, mjcf_xml = _files.read(Path(path), notes)
    log = make_log(meta, without_empty_cells(samples, notes), mjcf_xml)
    samples = without_missing_rows(log.samples, notes)
    _checks.check_loads(log.meta, samples)
    return dataclasses.replace(log, samples=samples, warnings=(*notes.warnings, *log.warnings))


def is_log(path: Path) -> bool:
    """Whether a folder holds a log."""
    return (path / _files.META_FILE).is_file()


def write_log(
    log: Log, path: Path, form: str = "parquet", provenance: dict | None = None, force: bool = False
) -> None:
    """Write a log as a folder, whole or not at all; `form` is 'parquet' or 'csv'.

    With `force` it replaces an earlier log. `provenance` goes to its own file, which `read_log`
    does not read. Raises LogError if the log is invalid or the folder exists.
    """
    log, folder = make_log(log.meta, log.samples, log.mjcf_xml), Path(path)
    check_target(folder, form, force)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary, old = (folder.with_name(f".{folder.name}.{end}") for end in ("tmp", "old"))
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        data = log.meta.model_dump(mode="json", by_alias=True, exclude_defaults=True)
        text = yaml.safe_dump(data, sort_keys=False, width=100)
        (temporary / _files.META_FILE).write_text(text)
        if isinstance(log.meta.mechanism, MjcfMechanism):
            (temporary / log.meta.mechanism.mjcf).write_text(log.mjcf_xml or "")
        if provenance is not None:
            text = json.dumps(provenance, indent=2) + "\n"
            (temporary / _files.PROVENANCE_FILE).write_text(text)
        _files.write_samples(log.samples, temporary, form)
        if folder.exists():
            os.rename(folder, old)
        os.rename(temporary, folder)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
