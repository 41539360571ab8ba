"""The files of a blind set: the public ones, and the sealed answers.

    DIR/commitment.json        hash of the answers, hashes of rules and solver, before any is solved
    DIR/cases/NNN/             one log each, and case.json: effects that are removed from the
                               solver's catalogue, and the number of the plant
    DIR/healthy/NN/NNNN/       healthy logs of plant NN, if there are any
    DIR/results/NNN.json       the solver's result
    DIR/results/make-NN.json   the solver's result on the healthy logs of plant NN
    DIR/rivals/NAME/NNN.json   the result of another method, if one was run
    DIR/tried.json             every version of the solver that was run on this set

The answers are a separate file, outside DIR.
"""

import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from diagnosis.blind.draw import Case, Fault, Settings

SCHEMA = 1


class BlindError(ValueError):
    """A blind set or its answers cannot be used; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Commitment:
    """The commitment that is published before anything is solved."""

    answers_sha256: str
    rules_version: int
    solver_sha256: str
    """Hash of all files below together."""
    files: dict[str, str]
    """SHA-256 of every file of the solver, its rules among them."""
    cases: int


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

    @property
    def makes(self) -> list[int]:
        """Numbers of the plants that have healthy logs."""
        return sorted(int(path.name) for path in (self.path / "healthy").glob("*"))

    def soundness(self, make: int) -> Path:
        """File of the solver's result on the healthy logs of a plant."""
        return self.path / "results" / f"make-{make:02d}.json"

    def make(self, number: int) -> int | None:
        """Number of a case's plant; None if it has no healthy logs."""
        return read_json(self.log(number) / "case.json").get("make")

    def excluded(self, number: int) -> tuple[str, ...]:
        """Effects that are removed from the solver's catalogue in a case."""
        return tuple(read_json(self.log(number) / "case.json")["excluded"])

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

    def rival(self, name: str, number: int) -> Path:
        """File of a rival's result for a case."""
        return self.path / "rivals" / name / f"{number:03d}.json"

    def read_rival(self, name: str, number: int) -> dict:
        """A rival's result for a case; empty if it was not run."""
        file = self.rival(name, number)
        return read_json(file) if file.exists() else {}

    def tried(self) -> list[dict]:
        """All versions of the solver that were run on this set, in order."""
        file = self.path / "tried.json"
        return read_json(file)["solvers"] if file.exists() else []

    def note_try(self, rules_version: int, solver_sha256: str) -> None:
        """Record that a version of the solver is run on this set."""
        found = self.tried()
        if solver_sha256 not in [one["solver_sha256"] for one in found]:
            found.append({"rules_version": rules_version, "solver_sha256": solver_sha256})
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
    found = hashlib.sha256(path.read_bytes()).hexdigest()
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
