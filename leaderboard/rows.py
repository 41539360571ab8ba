"""Result rows as files hold them: `run.json`, checked, and nothing of what produced it.

This file knows the layout of `run.json` and what its values may be; it must not know an engine, a
task or a learner, so that a row of a plug-in nobody here has heard of still reads.
"""

import reprlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
Name = Annotated[str, Field(min_length=1)]
CLASH = "with other scores; allowed: equal scores. The run that finished last counts"


class _Part(BaseModel):
    """A piece of `run.json`; fields it does not name are kept."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)


class RunIdentity(_Part):
    """What was run."""

    backend: Name
    hand: Name
    stick: Name
    effects: str
    task: Name
    radius_m: Positive
    """Size of the figure [m]."""
    speed: Positive
    """Pace of the figure over the training pace."""
    observation: Name
    algo: Name
    steps: Count
    """Training budget in environment steps."""
    seed: Count
    randomize: bool
    worlds: Count
    smoke: bool


class Scores(_Part):
    """Means over the evaluation's episodes."""

    p_err_cm: NotNegative
    """Error of the stick's lower end [cm]."""
    q_err_deg: Annotated[float, Field(ge=0, le=180)]
    """Error of the stick's axis [deg]."""
    held: Fraction
    """Fraction of the episode before the stick fell."""
    tracked: Fraction
    """Fraction of all reference steps with the stick held and both errors in bounds."""
    episodes: Annotated[int, Field(ge=1)]


class Provenance(_Part):
    """Where the row came from."""

    command: Name
    versions: dict[str, str]
    cpu: str
    cores: Count
    commit: str
    platform: str
    finished: str
    """When the run ended, ISO 8601."""


class Row(_Part):
    """One run."""

    schema_version: Literal[1] = Field(alias="schema")
    status: Literal["done", "diverged", "skipped", "interrupted"]
    reason: str
    spec: RunIdentity
    digest: Name
    """The run's identity: equal digests are one run."""
    spec_digest: Name
    """The nominal world's digest: hand, stick and effects."""
    scores: Scores | None
    """None unless the run is done."""
    steps: Count
    """Environment steps trained."""
    wall_s: NotNegative
    env_steps_per_s: NotNegative
    policy_sha256: str | None
    provenance: Provenance

    @field_validator("scores", mode="before")
    @classmethod
    def _only_of_done_runs(cls, value: object, info: ValidationInfo) -> object:
        done = info.data.get("status") == "done"
        if done and value is None:
            raise ValueError("Input should be the scores, for the run is done")
        return value if done else None


def read_rows(paths: Iterable[Path | str]) -> tuple[list[Row], list[str]]:
    """The rows under `paths`, one per run digest, and a message per file that could not be read.

    A path is a .json file, a run folder, a folder with run folders at any depth, or, where it has
    none, a folder of .json rows. Order and repetition of `paths` change nothing.
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
            read[file] = Row.model_validate_json(file.read_bytes())
        except OSError as error:
            problems.add(f"{file}: cannot be read ({error.strerror}); allowed: a readable file")
        except ValidationError as error:
            problems.add(f"{file}: {'; '.join(_complaints(error))}")
    problems.update(_conflicts(read))
    return unique(list(read.values())), sorted(problems)


def unique(rows: Sequence[Row]) -> list[Row]:
    """One row per run digest, in an order that does not depend on that of `rows`.

    Of equal digests a done run counts before others, then the one that finished last.
    """
    by_content = sorted(rows, key=lambda row: row.model_dump_json())
    by_worth = sorted(by_content, key=lambda row: (row.status == "done", row.provenance.finished))
    kept = {row.digest: row for row in by_worth}
    return sorted(kept.values(), key=lambda row: (row.spec.seed, row.digest))


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return list(path.rglob("run.json")) or list(path.glob("*.json"))
    return [path] if path.suffix == ".json" and path.exists() else []


def _conflicts(read: dict[Path, Row]) -> list[str]:
    """A message per done file whose scores are not those of an earlier file of the same run."""
    first: dict[str, Path] = {}
    texts = []
    for file, row in read.items():
        if row.status == "done":
            other = first.setdefault(row.digest, file)
            if row.scores != read[other].scores:
                texts.append(f"{file}: digest is {row.digest!r}, as in {other}, {CLASH}")
    return texts


def _complaints(error: ValidationError) -> list[str]:
    """What is wrong with a file, one text per field: the field, its value, what is allowed."""
    texts = []
    for item in error.errors(include_url=False):
        field = ".".join(map(str, item["loc"])) or "the file"
        message = item["msg"].removeprefix("Value error, ").removeprefix("Invalid JSON: ")
        if item["type"] == "json_invalid":
            texts.append(f"is not whole JSON ({message}); allowed: a finished run.json")
        elif item["type"] == "missing":
            texts.append(f"{field} is missing (required)")
        else:
            allowed = message.removeprefix("Input should be ")
            texts.append(f"{field} is {reprlib.repr(item['input'])}; allowed: {allowed}")
    return texts
