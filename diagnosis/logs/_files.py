"""The files of a log: read with a clear error for every fault, written completely or not at all.

This module knows file formats only; the numbers are checked in other modules.
"""

import csv
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from diagnosis.logs._meta import LogError, LogMeta, MjcfMechanism, dump_meta, parse_meta
from diagnosis.logs.plain_yaml import read_plain_yaml
from files import bounded, tables
from files.bounded import FileError

META_FILE, PARQUET_FILE, CSV_FILE = "log.yaml", "samples.parquet", "samples.csv"
PROVENANCE_FILE = "provenance.json"
FORMS = ("parquet", "csv")
MODELS = (".xml", ".mjcf", ".urdf")
"""Ends of a model's file name."""
MOST_MJCF_BYTES = 1_000_000
"""Largest MJCF file that is read."""


def read(folder: Path) -> tuple[LogMeta, pd.DataFrame, str | None, tuple[str, ...]]:
    """Meta, samples, the MJCF's text and warnings; raises LogError."""
    try:
        return _read(folder)
    except FileError as error:
        raise LogError(str(error)) from None


def _read(folder: Path) -> tuple[LogMeta, pd.DataFrame, str | None, tuple[str, ...]]:
    if not folder.is_dir():
        if folder.is_file():
            raise LogError(
                f"{folder} is a file; give its folder, which holds {META_FILE}, too, or "
                "with a table its robot's model"
            )
        raise LogError(f"no log folder at {folder}; give a folder that holds {META_FILE}")
    meta = parse_meta(_yaml(folder / META_FILE))
    found = [folder / name for name in (PARQUET_FILE, CSV_FILE) if (folder / name).is_file()]
    if len(found) != 1:
        names = "both {} and {}" if found else "neither {} nor {}"
        has = names.format(PARQUET_FILE, CSV_FILE)
        raise LogError(f"{folder} has {has}; allowed: exactly one of them")
    odd: list[str] = []
    is_csv = found[0].name == CSV_FILE
    samples = _csv(found[0], odd) if is_csv else tables.read_parquet(found[0])
    return meta, samples, _mjcf(folder, meta), tuple(odd)


def write(
    folder: Path,
    meta: LogMeta,
    samples: pd.DataFrame,
    mjcf_xml: str | None,
    form: str,
    provenance: dict | None,
    force: bool = False,
) -> None:
    """Write a folder under a temporary name, then rename it; raises LogError if it is taken.

    With `force` it takes the place of an earlier log.
    """
    check_target(folder, form, force)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary, old = (folder.with_name(f".{folder.name}.{end}") for end in ("tmp", "old"))
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir()
    try:
        text = yaml.safe_dump(dump_meta(meta), sort_keys=False, width=100)
        (temporary / META_FILE).write_text(text)
        if isinstance(meta.mechanism, MjcfMechanism):
            (temporary / meta.mechanism.mjcf).write_text(mjcf_xml or "")
        if provenance is not None:
            (temporary / PROVENANCE_FILE).write_text(json.dumps(provenance, indent=2) + "\n")
        _write(samples, temporary, form)
        if folder.exists():
            os.rename(folder, old)
        os.rename(temporary, folder)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_target(folder: Path, form: str, force: bool = False) -> None:
    """Raise LogError unless a log may be written to `folder` in a form.

    The folder must be new or empty, or with `force` hold a log and nothing else.
    """
    if form not in FORMS:
        raise LogError(f"no form of samples '{form}'; known: {', '.join(FORMS)}")
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not force:
        raise LogError(f"{folder} exists; choose another --out, or --force to replace it")
    if not (folder / META_FILE).is_file():
        raise LogError(f"{folder} is no log ({META_FILE} is missing), so --force leaves it alone")
    known = {META_FILE, PARQUET_FILE, CSV_FILE, PROVENANCE_FILE}
    for file in sorted(folder.iterdir()):
        if file.name not in known and file.suffix.lower() not in MODELS:
            raise LogError(
                f"{folder} holds {file.name}, which no log does, so --force leaves it alone; "
                "choose another --out"
            )


def _yaml(path: Path) -> object:
    try:
        return read_plain_yaml(path)
    except FileNotFoundError:
        below = path.parent / "log"
        if (below / META_FILE).is_file():
            raise LogError(f"{path.parent} is no log; did you mean {below}?") from None
        raise LogError(
            f"{path} does not exist; docs/reference/log-format.md has an example of eight lines"
        ) from None


def _mjcf(folder: Path, meta: LogMeta) -> str | None:
    if not isinstance(meta.mechanism, MjcfMechanism):
        return None
    return read_model(folder / meta.mechanism.mjcf)


def read_model(path: Path) -> str:
    """The text of an MJCF or URDF, with all that matters of other files; raises LogError."""
    from backends.mjcf import MjcfError, whole

    try:
        return whole(bounded.read_text(path, MOST_MJCF_BYTES), path.parent)
    except MjcfError as error:
        raise LogError(f"{path.name}: {error}") from None
    except FileNotFoundError:
        raise LogError(f"no model at {path}; give its own path, or copy it there") from None
    except FileError as error:
        raise LogError(f"the mechanism's file {error}") from None


def _csv(path: Path, odd: list[str]) -> pd.DataFrame:
    text = bounded.read_text(path, tables.MOST_BYTES)
    header = _header(path, text)
    _refuse_cut(path, text, len(header), odd)
    touch = {name: str for name in header if name.startswith("touch.")}
    frame = tables.parse_csv(path, text, names=header, header=0, dtype=touch)
    for name in touch:
        frame[name] = [_numbers(path, name, row, cell) for row, cell in enumerate(frame[name])]
    return frame


def _header(path: Path, text: str) -> list[str]:
    first = text.split("\n", 1)[0]
    header = [name.strip() for name in next(csv.reader([first]), [])]
    if not any(header):
        raise LogError(f"{path} is empty; its first line must hold the column names")
    if len(header) == 1 and (";" in first or "\t" in first):
        raise LogError(f"{path} is not separated by commas; allowed: commas, and decimal points")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise LogError(f"{path} has two columns '{twice[0]}'; use every name once")
    return header


def _refuse_cut(path: Path, text: str, columns: int, odd: list[str]) -> None:
    """Raise LogError if the last line is shorter than the header."""
    last = text.rstrip("\n").rsplit("\n", 1)[-1]
    given = len(next(csv.reader([last]), []))
    if given < columns:
        raise LogError(
            f"{path} is incomplete: its last line has {given} of {columns} values; "
            "remove that line or record it again"
        )
    if not text.endswith("\n"):
        odd.append(f"{path.name} has no newline at its end; its last value may be incomplete")


def _numbers(path: Path, name: str, row: int, cell: object) -> np.ndarray | None:
    """A touch cell of a CSV: numbers separated by spaces, or empty."""
    if not isinstance(cell, str):
        return None
    try:
        return np.array(cell.split(), dtype=np.float32)
    except ValueError:
        raise LogError(
            f"{path}, sample {row}: '{name}' is '{cell[:30]}'; allowed: numbers separated by spaces"
        ) from None


def _write(samples: pd.DataFrame, folder: Path, form: str) -> None:
    touch = [name for name in samples.columns if name.startswith("touch.")]
    cell = (lambda c: " ".join(map(str, c))) if form == "csv" else lambda c: c.astype(np.float32)
    plain = samples.assign(
        **{name: [None if c is None else cell(c) for c in samples[name]] for name in touch}
    )
    if form == "csv":
        plain.to_csv(folder / CSV_FILE, index=False, lineterminator="\n")
    else:
        plain.to_parquet(folder / PARQUET_FILE, index=False, compression="zstd")
