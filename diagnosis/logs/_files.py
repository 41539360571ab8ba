"""The files of a log: read with a clear error for every fault.

This module knows file formats only; the numbers are checked in other modules.
"""

import csv
from pathlib import Path

import numpy as np
import pandas as pd

from diagnosis.logs._meta import LogError, LogMeta, MjcfMechanism, as_log_errors, parse_meta
from diagnosis.logs.stamps import Notes
from files import bounded, tables
from files.plain_yaml import read_plain_yaml

META_FILE, PARQUET_FILE, CSV_FILE = "log.yaml", "samples.parquet", "samples.csv"
PROVENANCE_FILE = "provenance.json"
FORMS = ("parquet", "csv")
MODELS = (".xml", ".mjcf", ".urdf")
"""Ends of a model's file name."""
MOST_MJCF_BYTES = 1_000_000
"""Largest MJCF file that is read."""


@as_log_errors()
def read(folder: Path, notes: Notes) -> tuple[LogMeta, pd.DataFrame, str | None]:
    """Meta, samples and the MJCF's text; raises LogError."""
    if folder.is_file():
        raise LogError(
            f"{folder} is a file; give its folder, which holds {META_FILE}, too, or "
            "with a table its robot's model"
        )
    if not folder.is_dir():
        raise LogError(f"no log folder at {folder}; give a folder that holds {META_FILE}")
    try:
        meta = parse_meta(read_plain_yaml(folder / META_FILE))
    except FileNotFoundError:
        if (folder / "log" / META_FILE).is_file():
            raise LogError(f"{folder} is no log; did you mean {folder / 'log'}?") from None
        raise LogError(
            f"{folder / META_FILE} does not exist; docs/reference/log-format.md has an example of "
            "eight lines"
        ) from None
    found = [folder / name for name in (PARQUET_FILE, CSV_FILE) if (folder / name).is_file()]
    if len(found) != 1:
        names = "both {} and {}" if found else "neither {} nor {}"
        has = names.format(PARQUET_FILE, CSV_FILE)
        raise LogError(f"{folder} has {has}; allowed: exactly one of them")
    is_csv = found[0].name == CSV_FILE
    samples = _csv(found[0], notes) if is_csv else tables.read_parquet(found[0])
    mjcf = meta.mechanism.mjcf if isinstance(meta.mechanism, MjcfMechanism) else None
    return meta, samples, read_model(folder / mjcf) if mjcf else None


def check_target(folder: Path, form: str, force: bool) -> None:
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


def read_model(path: Path) -> str:
    """The text of an MJCF or URDF, with all that matters of other files; raises LogError."""
    from backends.mjcf import whole

    try:
        with as_log_errors("the mechanism's file "):
            text = bounded.read_text(path, MOST_MJCF_BYTES)
    except FileNotFoundError:
        raise LogError(f"no model at {path}; give its own path, or copy it there") from None
    with as_log_errors(f"{path.name}: "):
        return whole(text, path.parent)


def _csv(path: Path, notes: Notes) -> pd.DataFrame:
    """The samples in a CSV file; touch cells are numbers between spaces."""
    text = bounded.read_text(path, tables.MOST_BYTES)
    first, last = text.split("\n", 1)[0], text.rstrip("\n").rsplit("\n", 1)[-1]
    header, given = ([c.strip() for c in next(csv.reader([line]), [])] for line in (first, last))
    if not any(header):
        raise LogError(f"{path} is empty; its first line must hold the column names")
    if len(header) == 1 and (";" in first or "\t" in first):
        raise LogError(f"{path} is not separated by commas; allowed: commas, and decimal points")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise LogError(f"{path} has two columns '{twice[0]}'; use every name once")
    if len(given) < len(header):
        raise LogError(
            f"{path} is incomplete: its last line has {len(given)} of {len(header)} values; "
            "remove that line or record it again"
        )
    if not text.endswith("\n"):
        said = f"{path.name} has no newline at its end; its last value may be incomplete"
        notes.warnings.append(said)
    touch = {name: str for name in header if name.startswith("touch.")}
    frame = tables.parse_csv(path, text.encode(), names=header, header=0, dtype=touch)
    for name in touch:
        frame[name] = [_cell(path, name, row, cell) for row, cell in enumerate(frame[name])]
    return frame


def _cell(path: Path, name: str, row: int, cell: object) -> np.ndarray | None:
    if not isinstance(cell, str):
        return None
    try:
        return np.array(cell.split(), dtype=np.float32)
    except ValueError:
        raise LogError(
            f"{path}, sample {row}: '{name}' is '{cell[:30]}'; allowed: numbers separated by spaces"
        ) from None


def write_samples(samples: pd.DataFrame, folder: Path, form: str) -> None:
    """Write the samples into a folder."""
    touch = [name for name in samples.columns if name.startswith("touch.")]
    cell = (lambda c: " ".join(map(str, c))) if form == "csv" else lambda c: c.astype(np.float32)
    plain = samples.assign(
        **{name: [None if c is None else cell(c) for c in samples[name]] for name in touch}
    )
    if form == "csv":
        plain.to_csv(folder / CSV_FILE, index=False, lineterminator="\n")
    else:
        plain.to_parquet(folder / PARQUET_FILE, index=False, compression="zstd")
