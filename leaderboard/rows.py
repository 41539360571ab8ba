"""Read result rows from files: find and check them, keep one per run, report what is wrong."""

import reprlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import ValidationError

from files.bounded import FileError, read_bytes
from leaderboard.details import DetailsError, read_details
from leaderboard.row import Row

RUN_FILE = "run.json"
CLASH = "with other scores; allowed: equal scores. The run that finished last counts"


def read_rows(paths: Iterable[Path | str]) -> tuple[list[Row], list[str]]:
    """The rows under `paths`, one per run digest, and a message per unreadable file.

    A path is a .json file, a run folder, a folder with run folders at any depth, or else a folder
    of .json rows. Order and repetition of `paths` change nothing. The row of a run folder gets its
    details from the other files of the folder.
    """
    files: set[Path] = set()
    problems: set[str] = set()
    read: dict[Path, Row] = {}
    for path in map(Path, paths):
        found = _files(path)
        files.update(found)
        if not found:
            problems.add(f"{path}: no result here; allowed: a .json file or a folder with run.json")
    for file in {file.resolve(): file for file in sorted(files)}.values():
        try:
            read[file] = Row.model_validate_json(read_bytes(file))
            read[file] = _with_details(read[file], file)
        except (DetailsError, FileError) as error:
            problems.add(str(error))
        except OSError as error:
            problems.add(f"{file}: cannot be read ({error.strerror}); allowed: a readable file")
        except ValidationError as error:
            read.pop(file, None)
            problems.add(f"{file}: {'; '.join(_complaints(error))}")
    problems.update(_conflicts(read))
    return unique(list(read.values())), sorted(problems)


def unique(rows: Sequence[Row]) -> list[Row]:
    """One row per run digest, in an order that is independent of that of `rows`.

    Among equal digests, done runs come first, then the one that finished last, then the one with
    scores per episode.
    """
    by_content = sorted(rows, key=lambda row: row.model_dump_json())
    kept = {row.digest: row for row in sorted(by_content, key=_worth)}
    return sorted(kept.values(), key=lambda row: (row.spec.seed, row.digest))


def _worth(row: Row) -> tuple[bool, str, bool]:
    return row.status == "done", row.provenance.finished, row.episodes is not None


def _with_details(row: Row, file: Path) -> Row:
    """The row of a run folder with its details.

    Raises DetailsError where they cannot be read, ValidationError where they are another row's.
    """
    if file.name != RUN_FILE or row.status != "done" or row.episodes is not None:
        return row
    details = read_details(file.parent)
    return Row.model_validate({**row.model_dump(by_alias=True, exclude_unset=True), **details})


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return list(path.rglob(RUN_FILE)) or list(path.glob("*.json"))
    return [path] if path.suffix == ".json" and path.exists() else []


def _conflicts(read: dict[Path, Row]) -> list[str]:
    """A message per done file whose scores differ from those of an earlier file of the same run."""
    first: dict[str, Path] = {}
    texts = []
    for file, row in read.items():
        if row.status == "done":
            other = first.setdefault(row.digest, file)
            if row.scores != read[other].scores:
                texts.append(f"{file}: digest is {row.digest!r}, as in {other}, {CLASH}")
    return texts


def _complaints(error: ValidationError) -> list[str]:
    """The faults of a file, one text per field: the field, its value, what is allowed."""
    texts = []
    for item in error.errors(include_url=False):
        field = ".".join(map(str, item["loc"])) or "the file"
        message = item["msg"].removeprefix("Value error, ").removeprefix("Invalid JSON: ")
        if item["type"] == "json_invalid":
            texts.append(f"is not complete JSON ({message}); allowed: a finished run.json")
        elif not item["loc"]:
            texts.append(message)
        elif item["type"] == "missing":
            texts.append(f"{field} is missing (required)")
        else:
            allowed = message.removeprefix("Input should be ")
            texts.append(f"{field} is {reprlib.repr(item['input'])}; allowed: {allowed}")
    return texts
