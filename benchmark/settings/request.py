"""Build a RunSpec from the options and files that a user gives."""

import ast
import json
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from benchmark.errors import UsageError, unknown
from benchmark.parts import registry
from benchmark.settings.run_spec import SMOKE_STEPS, SMOKE_WORLDS, RunSpec, read_settings
from files.bounded import FileError
from files.plain_yaml import read_plain_yaml


def requested(
    given: Mapping[str, Any],
    calibration: Path | None = None,
    overrides: Mapping[str, Any] | None = None,
    config: Path | None = None,
    start: Path | None = None,
) -> RunSpec:
    """The requested run; raises UsageError.

    `given` are settings by name (None: not given); they override those of `config`. `overrides` are
    hyperparameters by name. `start` is the run whose policy is the start of the training.
    """
    fields, kept = _of_file(config) if config is not None else ({}, {})
    fields |= read_settings(given)
    if calibration is not None:
        fields |= _of_calibration(calibration, given)
    for name in ("backend", "task"):
        if name not in fields:
            raise UsageError(f"{config} has no {name}; give it there or as --{name}")
    algo = fields.get("algo", RunSpec.algo)
    if algo in registry.scripted():
        fields |= {"steps": 0, "randomize": False}
    elif fields.get("steps") == 0:
        raise UsageError(
            f"--steps is 0; allowed: from 1, or --algo {' or '.join(registry.scripted())}"
        )
    if fields.get("smoke"):
        fields["worlds"] = SMOKE_WORLDS
        fields["steps"] = min(fields.get("steps", SMOKE_STEPS), SMOKE_STEPS)
    fields["overrides"] = checked_overrides(algo, {**kept, **(overrides or {})})
    if fields.get("start_sha256") is not None and start is None:
        raise UsageError(f"the run of {config} started from a policy; give that run as --from RUN")
    if start is not None:
        fields["start_sha256"] = _policy_sha256(start, algo)
    try:
        return RunSpec(**fields)
    except UsageError as error:
        if calibration is None:
            raise
        raise UsageError(f"--calibration {calibration}: {error}") from error


def read_pairs(pairs: Sequence[str]) -> dict[str, Any]:
    """Hyperparameters from words such as 'lr=3e-4'; raises UsageError."""
    found = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not (name and equals and text):
            raise UsageError(f"--set is '{pair}'; allowed: KEY=VALUE, such as lr=3e-4")
        try:
            found[name.strip()] = ast.literal_eval(text)
        except (ValueError, SyntaxError):
            found[name.strip()] = text
    return found


def checked_overrides(algo: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """The changed hyperparameters, checked, as plain data; raises UsageError."""
    if not overrides:
        return {}
    hyperparameters = registry.load("algo", algo).hyperparameters
    if hyperparameters is None:
        raise UsageError(f"--set gives {', '.join(overrides)}, but {algo} does not learn")
    plain = asdict(hyperparameters())
    for name in overrides:
        if name not in plain:
            raise unknown(f"hyperparameter of {algo}", name, plain)
    try:
        made = TypeAdapter(hyperparameters).validate_python(dict(overrides))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(map(str, first["loc"]))
        allowed = first["msg"].removeprefix("Input should be ")
        raise UsageError(f"--set {name} is {first['input']!r}; allowed: {allowed}") from error
    return json.loads(json.dumps({n: v for n, v in asdict(made).items() if v != plain[n]}))


def _of_file(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of a RunSpec and hyperparameters from a run.json, or from settings as YAML."""
    data = _read(path)
    if isinstance(data.get("spec"), dict):
        fields = dict(data["spec"])
        kept = _hyperparameters(path, fields.pop("overrides", {}))
        if strange := sorted(map(str, set(fields) - set(RunSpec.__dataclass_fields__))):
            raise UsageError(
                f"{path}: spec has {', '.join(strange)}, which this version does not know"
            )
        return fields, kept
    names = {str(name): value for name, value in data.items()}
    kept = _hyperparameters(path, names.pop("set", None) or {})
    try:
        return read_settings(names), kept
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error


def _hyperparameters(path: Path, given: object) -> dict[str, Any]:
    if not (isinstance(given, dict) and all(isinstance(name, str) for name in given)):
        said = reprlib.repr(given)
        raise UsageError(f"{path}: hyperparameters are {said}; allowed: values by name")
    return given


def _read(path: Path) -> dict:
    try:
        data = read_plain_yaml(path)
    except FileNotFoundError:
        raise UsageError(f"no file of settings at {path}") from None
    except FileError as error:
        raise UsageError(str(error)) from error
    if not isinstance(data, dict):
        raise UsageError(f"{path} holds no settings; allowed: a run.json, or NAME: VALUE lines")
    return data


def _of_calibration(path: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Effects and spread of the calibration that is given; raises UsageError."""
    from benchmark.gap.calibrate import world_of

    for option in ("effects", "spread"):
        if given.get(option) is not None:
            raise UsageError(f"--calibration and --{option} both define the worlds; leave one out")
    return world_of(path, RunSpec.hand)


def _policy_sha256(run: Path, algo: str) -> str:
    """The SHA-256 of a finished run's policy; raises UsageError if it cannot be used."""
    from benchmark.runs.run_folder import finished_run

    found = finished_run(run)
    if found["policy_sha256"] is None or algo in registry.scripted():
        raise UsageError(
            f"--from {run}: {algo} and a scripted baseline learn nothing; leave it out"
        )
    return found["policy_sha256"]
