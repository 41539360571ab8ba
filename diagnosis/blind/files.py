"""The files of a blind set: the public ones, and the sealed answers.

    DIR/commitment.json        hashes of the answers, the logs and the solver, before any is solved
    DIR/cases/NNN/             one log each, and case.json: effects that are removed from the
                               solver's catalogue, and the number of the plant
    DIR/healthy/NN/NNNN/       healthy logs of plant NN, if there are any
    DIR/results/NNN.json       the solver's result, with the hashes of log and solver, and its time
    DIR/tried.json             every version of the solver that was run on this set

The answers are a separate file, outside DIR.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from diagnosis.blind.draw import Case, Settings
from files import bounded
from files.atomic import write_atomically
from files.bounded import FileError, one_line

SCHEMA = 2
AS_MADE = "take the set as it was made"


T = TypeVar("T")


class BlindError(FileError):
    """A blind set or its answers cannot be used; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Commitment:
    """The commitment that is published before anything is solved."""

    answers_sha256: str
    logs_sha256: dict[str, str]
    """Of every case, by its number: `BlindSet.log_sha256`."""
    solver_sha256: str
    """Hash of all files below together."""
    files: dict[str, str]
    """SHA-256 of every file of the solver."""

    @property
    def cases(self) -> int:
        """Their number."""
        return len(self.logs_sha256)


@dataclass(frozen=True, kw_only=True)
class Given:
    """The facts that a solver may use beside a case's log."""

    excluded: tuple[str, ...]
    """Effects that are removed from the solver's catalogue."""
    robot: bool
    """Whether the log is from a robot and not from a simulator."""
    make: int | None = None
    """Number of the plant's healthy logs, if there are any."""


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Magnitude(_Strict):
    effect: str
    joints: list[str]
    magnitude: float
    interval: list[float] = Field(min_length=2, max_length=2)


class _Result(_Strict):
    """What the score reads of a result, if it is there."""

    log_sha256: str
    solver_sha256: str
    refused: str | None
    excluded: list[str]
    cpu_s: float
    verdict: list[str] = []
    joints: list[str] = []
    leading: list[str] = []
    indistinguishable: list[list[str]] = []
    magnitudes: list[_Magnitude] = []
    confidence: float | None = None
    share: float | None = None
    left: float | None = None
    gap_nominal: float | None = None
    features: dict[str, Any] = {}


class _Try(_Strict):
    solver_sha256: str
    time: str


class _Tried(_Strict):
    solvers: list[_Try]


@dataclass(frozen=True, kw_only=True)
class BlindSet:
    """The folder of a set."""

    path: Path

    @property
    def numbers(self) -> range:
        """The numbers of the cases."""
        return range(self.commitment().cases)

    def log(self, number: int) -> Path:
        """Folder of a case's log."""
        return self.path / "cases" / f"{number:03d}"

    def result(self, number: int) -> Path:
        """File of a case's result."""
        return self.path / "results" / f"{number:03d}.json"

    def healthy(self, make: int) -> Path:
        """Folder of the healthy logs of a plant, by its number."""
        return self.path / "healthy" / f"{make:02d}"

    def given(self, number: int) -> Given:
        """The facts that a solver may use beside a case's log."""
        file = self.log(number) / "case.json"
        return _checked(Given, read_json(file), file)

    def healthy_logs(self, number: int) -> list[Path]:
        """Folders of the healthy logs of a case's plant."""
        make = self.given(number).make
        return [] if make is None else sorted(self.healthy(make).iterdir())

    def log_sha256(self, number: int) -> str:
        """Hash of all that a solver is given of a case: its log, its facts and healthy logs."""
        digest = hashlib.sha256()
        for folder in (self.log(number), *self.healthy_logs(number)):
            for file in sorted(folder.iterdir()):
                digest.update(f"{file.name} {_sha256(file)}\n".encode())
        return digest.hexdigest()

    def commitment(self) -> Commitment:
        """The commitment of the set; raises BlindError if there is none."""
        file = self.path / "commitment.json"
        if not file.exists():
            raise BlindError(
                f"no {file.name} in {self.path}; give a folder that `bench blind make` finished"
            )
        data = read_json(file)
        if data.pop("schema", None) != SCHEMA or set(data) != set(Commitment.__annotations__):
            raise BlindError(f"{file} has another format version; make the set again")
        found = _checked(Commitment, data, file)
        if list(found.logs_sha256) != [f"{n:03d}" for n in range(found.cases)]:
            raise BlindError(f"{file} does not name cases 000, 001 and so on; {AS_MADE}")
        return found

    def commit(self, commitment: Commitment) -> None:
        """Write the commitment, which completes the set."""
        write_json(self.path / "commitment.json", {"schema": SCHEMA, **asdict(commitment)})

    def read_result(self, number: int) -> dict | None:
        """The solver's result for a case; None if it has not solved it."""
        file = self.result(number)
        if not file.exists():
            return None
        said = read_json(file)
        _checked(_Result, said, file)
        return said

    def tried(self) -> list[dict]:
        """All versions of the solver that were run on this set, in order."""
        file = self.path / "tried.json"
        if not file.exists():
            return []
        return [one.model_dump() for one in _checked(_Tried, read_json(file), file).solvers]

    def note_try(self, solver_sha256: str) -> None:
        """Record that a version of the solver is run on this set."""
        found = self.tried()
        if solver_sha256 not in [one["solver_sha256"] for one in found]:
            found.append({"solver_sha256": solver_sha256, "time": now()})
            write_json(self.path / "tried.json", {"solvers": found})


@dataclass(frozen=True, kw_only=True)
class Answers:
    """The sealed answers."""

    settings: dict
    seed: int
    cases: tuple[Case, ...]


def seal(settings: Settings, seed: int, cases: tuple[Case, ...]) -> str:
    """The text of the answers; a nonce prevents guessing them from their hash."""
    nonce = hashlib.sha256(f"stickbench blind {seed}".encode()).hexdigest()
    said = {"schema": SCHEMA, "nonce": nonce, "seed": str(seed), "settings": asdict(settings)}
    return dumps(said | {"cases": [asdict(case) for case in cases]})


def open_answers(path: Path, commitment: Commitment) -> Answers:
    """The answers, if they fit the commitment; raises BlindError."""
    if not path.is_file():
        raise BlindError(f"no answers at {path}; give the file that `bench blind make` wrote")
    found = _sha256(path)
    if found != commitment.answers_sha256:
        raise BlindError(
            f"the SHA-256 of {path} is {found}, but {commitment.answers_sha256} was committed; "
            "these are other answers, or they were changed: give those of this set"
        )
    return _checked(Answers, read_json(path), path)


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def now() -> str:
    """The time, to the second, UTC."""
    return f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"


def dumps(data: Any) -> str:
    """JSON text that ends with a newline."""
    return json.dumps(data, indent=1) + "\n"


def write_json(path: Path, data: Any) -> None:
    """Write a JSON file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, dumps(data))


def read_json(path: Path) -> dict:
    """A JSON object; raises BlindError."""
    try:
        return bounded.read_json(path)
    except (OSError, FileError) as error:
        raise BlindError(f"{error}; {AS_MADE}") from None


def _checked(kind: type[T], data: dict, path: Path) -> T:
    """The data as what they should be; raises BlindError that names the field."""
    try:
        return TypeAdapter(kind).validate_python(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        raise BlindError(
            f"{path} is damaged: {one_line(field)} is {one_line(repr(first['input']))}; "
            f"{first['msg']}; {AS_MADE}"
        ) from None
