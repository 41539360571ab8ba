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
import os
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from diagnosis.blind.draw import Case, Settings
from diagnosis.blind.faults import Fault

SCHEMA = 2


class BlindError(ValueError):
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

    def given(self, number: int) -> dict:
        """The facts that a solver may use beside a case's log."""
        return read_json(self.log(number) / "case.json")

    def healthy_logs(self, number: int) -> list[Path]:
        """Folders of the healthy logs of a case's plant."""
        make = self.given(number).get("make")
        return [] if make is None else sorted(self.healthy(make).iterdir())

    def log_sha256(self, number: int) -> str:
        """Hash of all that a solver is given of a case: its log, its facts and healthy logs."""
        digest = hashlib.sha256()
        for folder in (self.log(number), *self.healthy_logs(number)):
            for file in sorted(folder.iterdir()):
                digest.update(f"{file.name} {_sha256(file)}\n".encode())
        return digest.hexdigest()

    def excluded(self, number: int) -> tuple[str, ...]:
        """Effects that are removed from the solver's catalogue in a case."""
        return tuple(self.given(number)["excluded"])

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
        return Commitment(**data)

    def commit(self, commitment: Commitment) -> None:
        """Write the commitment, which completes the set."""
        write_json(self.path / "commitment.json", {"schema": SCHEMA, **asdict(commitment)})

    def read_result(self, number: int) -> dict | None:
        """The solver's result for a case; None if it has not solved it."""
        file = self.result(number)
        return read_json(file) if file.exists() else None

    def tried(self) -> list[dict]:
        """All versions of the solver that were run on this set, in order."""
        file = self.path / "tried.json"
        return read_json(file)["solvers"] if file.exists() else []

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
    data = read_json(path)
    cases = tuple(_case(row) for row in data["cases"])
    return Answers(settings=data["settings"], seed=int(data["seed"]), cases=cases)


def _case(row: dict) -> Case:
    hidden = {key: tuple(Fault(**fault) for fault in row[key]) for key in ("faults", "nominal")}
    lists = {key: tuple(row[key]) for key in ("channels", "protocols", "excluded")}
    return Case(**{**row, **lists, **hidden})


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def now() -> str:
    """The time, to the second, UTC."""
    return f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"


def dumps(data: Any) -> str:
    """JSON text that ends with a newline."""
    return json.dumps(data, indent=1) + "\n"


def write_json(path: Path, data: Any) -> None:
    """Write a JSON file under a temporary name, then rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(dumps(data))
    os.replace(temporary, path)


def read_json(path: Path) -> dict:
    """A JSON object; raises BlindError."""
    try:
        data = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BlindError(f"{path} cannot be read as JSON: {error}") from None
    if not isinstance(data, dict):
        raise BlindError(f"{path} holds no JSON object; make the set again")
    return data
