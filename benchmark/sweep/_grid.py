"""A sweep's YAML file: checked field by field, then expanded to cells.

A cell is given by the options of `bench run`, written as on the command line.
"""

import difflib
import itertools
import math
import reprlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    create_model,
    model_validator,
)

from benchmark.errors import UsageError
from benchmark.settings import quantities
from benchmark.settings.kinds import Setting
from benchmark.settings.request import requested
from benchmark.settings.run_spec import SETTINGS, RunSpec
from files.bounded import FileError
from files.plain_yaml import read_plain_yaml

Text = Annotated[str, Field(min_length=1)]
MOST_CELLS = 5_000
"""Most cells of a sweep."""


def _checked_by(one: Setting) -> Any:
    """A field of the file that a setting reads; what it cannot read is said as on its flag."""

    def check(value: object) -> object:
        try:
            one.read(value)
        except UsageError as error:
            raise ValueError(str(error)) from error
        return value

    return Annotated[Any, AfterValidator(check)]


class _Part(BaseModel):
    """A part of the file; unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class _Named(_Part):
    """Settings, each under any of its names."""

    @model_validator(mode="before")
    @classmethod
    def by_name(cls, data: Any) -> Any:
        """Give every setting its first name."""
        if not isinstance(data, dict):
            return data
        first = {other: one.names[0] for one in SETTINGS.values() for other in one.names}
        named = {first.get(name, name): value for name, value in data.items()}
        if len(named) < len(data):
            raise ValueError("a setting is given twice under two names")
        return named


Settings: Any = create_model(
    "Settings",
    __base__=_Named,
    **{  # type: ignore
        name.replace("-", "_"): (_checked_by(one) | None, None) for name, one in SETTINGS.items()
    },
    calibration=(Text | None, None),
    set=(dict[str, Any] | None, None),
)
"""Options of `bench run`; missing ones have their default."""


class Slurm(_Part):
    """Requests to the scheduler of a cluster, per cell."""

    partition: Text | None = None
    account: Text | None = None
    cpus: Annotated[int, Field(ge=1)] = 1
    """Number of cores; it changes no result."""
    memory_gb: Annotated[float, Field(gt=0)] = 8.0
    setup: list[Text] = []
    """Shell lines before the cell, such as 'module load python/3.11'."""
    options: dict[str, str | int | bool] = {}
    """Any other option of sbatch, without its dashes."""


_Lists: Any = create_model(
    "_Lists",
    __base__=_Named,
    **{
        name: (Annotated[list[field.annotation], Field(min_length=1)] | None, None)  # type: ignore
        for name, field in Settings.model_fields.items()
    },
)
"""The same options, each with a list of values."""


class _File(_Part):
    defaults: Settings = Settings()
    grid: _Lists = _Lists()
    cells: list[Settings] = []
    time_limit: Text = "24h"
    slurm: Slurm = Slurm()


@dataclass(frozen=True, kw_only=True)
class Choice:
    """One cell: its options and its run."""

    options: dict[str, Any]
    """Options of `bench run`, by name."""
    spec: RunSpec


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A sweep."""

    choices: tuple[Choice, ...]
    """The cells, each of them once."""
    time_limit_s: float
    """Time after which a cell is stopped [s]."""
    slurm: Slurm


def read_grid(path: Path) -> Grid:
    """Read a sweep file; raises UsageError with the field, its value and what is allowed.

    The cells are `defaults` with every combination of the `grid`, then with each of the `cells`.
    """
    file = _checked(path)
    lists = _given(file.grid)
    if not lists and not file.cells:
        raise UsageError(f"{path} has no cell; give 'grid', 'cells' or both")
    _refuse_many(path, lists, len(file.cells))
    combinations = itertools.product(*lists.values()) if lists else ()
    chosen = [dict(zip(lists, values, strict=True)) for values in combinations]
    chosen += [_given(cell) for cell in file.cells]
    choices = [_choice(path, {**_given(file.defaults), **options}) for options in chosen]
    once: dict[str, Choice] = {}
    for choice in choices:
        once.setdefault(choice.spec.digest, choice)
    return Grid(
        choices=tuple(once.values()),
        time_limit_s=_time_limit_s(file, path),
        slurm=file.slurm,
    )


def _refuse_many(path: Path, lists: dict[str, Any], more: int) -> None:
    """Raise UsageError if the grid has more cells than a sweep can keep an eye on."""
    count = (math.prod(map(len, lists.values())) if lists else 0) + more
    if count > MOST_CELLS:
        raise UsageError(f"{path} has {count:.6g} cells; allowed: up to {MOST_CELLS}; cut it up")


def _time_limit_s(file: _File, path: Path) -> float:
    limit_s = quantities.quantity(file.time_limit, f"{path}: time_limit", "h")
    if not (math.isfinite(limit_s) and limit_s > 0):
        raise UsageError(f"{path}: time_limit is {file.time_limit}; allowed: a time above 0")
    return limit_s


def _choice(path: Path, options: dict[str, Any]) -> Choice:
    typed = ", ".join(f"{name}={value}" for name, value in options.items())
    for name in ("backend", "task"):
        if name not in options:
            raise UsageError(f"{path}, cell ({typed}): {name} is missing (required)")
    given = {name.replace("_", "-"): value for name, value in options.items()}
    calibration, overrides = given.pop("calibration", None), given.pop("set", None)
    try:
        spec = requested(given, Path(calibration) if calibration else None, overrides)
    except UsageError as error:
        raise UsageError(f"{path}, cell ({typed}): {error}") from error
    return Choice(options=options, spec=spec)


def _given(part: BaseModel) -> dict[str, Any]:
    return {name: value for name, value in part if value is not None}


def _checked(path: Path) -> _File:
    try:
        content = read_plain_yaml(path)
        return _File.model_validate({} if content is None else content)
    except FileNotFoundError:
        raise UsageError(f"no sweep file at {path}") from None
    except FileError as error:
        raise UsageError(str(error)) from error
    except ValidationError as error:
        raise UsageError(f"{path}: {'; '.join(_complaints(error))}") from error


def _complaints(error: ValidationError) -> list[str]:
    """The faults of the file: the field, its value, what is allowed."""
    texts = []
    for item in error.errors(include_url=False):
        field = ".".join(map(str, item["loc"])) or "the file"
        if item["type"] == "extra_forbidden":
            texts.append(f"{field} is not a setting; allowed: {_siblings(item['loc'])}")
        elif item["type"] == "value_error":
            texts.append(f"{field}: {item['msg'].removeprefix('Value error, ')}")
        else:
            allowed = item["msg"].removeprefix("Input should be ")
            texts.append(f"{field} is {reprlib.repr(item['input'])}; allowed: {allowed}")
    return texts


def _siblings(place: tuple[int | str, ...]) -> str:
    """The names that are allowed at a place of the file, and a similar one."""
    model = Slurm if "slurm" in place[:-1] else Settings if len(place) > 1 else _File
    names = sorted(model.model_fields)
    near = difflib.get_close_matches(str(place[-1]), names, n=1, cutoff=0.5)
    return ", ".join(names) + (f". Did you mean '{near[0]}'?" if near else "")
