"""One blind score: what `bench blind score --out` writes as score.json, read and checked.

Nothing is known here of effects or of the solver: only which figures a score has.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

MODES = ("single", "pair", "none", "unknown")


class ScoreError(ValueError):
    """A file is no score; the message is complete."""


class Kind(NamedTuple):
    """What sets have in common of which a newer one supersedes an older one."""

    rig: str
    sides: tuple[str, ...]
    """Real sides, in order of the alphabet."""
    modes: str
    """`all`, or the modes of the cases."""
    healthy: bool
    """Whether the solver was given healthy logs."""


@dataclass(frozen=True)
class Counted:
    """A figure and over how much it is."""

    value: float | None
    count: int

    @property
    def hits(self) -> int:
        """How many a share counts."""
        return round((self.value or 0) * self.count)


class Interval(BaseModel):
    """Interval and count of a figure."""

    model_config = ConfigDict(extra="allow", frozen=True)

    low: float | None
    high: float | None
    count: int


class Score(BaseModel):
    """A score as its file holds it; its figures are plain numbers beside these fields."""

    model_config = ConfigDict(extra="allow", frozen=True)

    cases: int
    frozen: bool
    """Whether the solver was the one that was committed to before the draw."""
    healthy: int = 0
    """Healthy logs of every real side."""
    intervals: dict[str, Interval]
    tables: dict[str, list[dict[str, Any]]] = Field(default_factory=dict)

    def figure(self, name: str) -> Counted:
        """A figure of all cases; None over nothing where the score has no such figure."""
        known = self.intervals.get(name)
        value = (self.model_extra or {}).get(name)
        return Counted(value, known.count if known and value is not None else 0)

    def of_side(self, side: str, name: str) -> Counted:
        """A figure of the cases of one real side."""
        row = next(row for row in self._groups("real") if row["of"] == side)
        return Counted(row.get(name), row.get(f"{name}_n") or 0)

    @property
    def kind(self) -> Kind:
        """What of its sets this one is."""
        found = {row["mode"] for row in self.tables["cases"]}
        modes = "all" if found == set(MODES) else "+".join(m for m in MODES if m in found)
        rigs, sides = (sorted(row["of"] for row in self._groups(by)) for by in ("rig", "real"))
        return Kind("+".join(rigs), tuple(sides), modes, self.healthy > 0)

    def _groups(self, by: str) -> list[dict[str, Any]]:
        return [row for row in self.tables["groups"] if row["by"] == by]


def read_score(path: Path) -> Score:
    """The score in a file; raises ScoreError."""
    try:
        score = Score.model_validate_json(path.read_bytes())
        _ = score.kind
    except OSError as error:
        raise ScoreError(f"{path} cannot be read: {error.strerror}") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"])) or "the file"
        raise ScoreError(
            f"{path} is no blind score: {field}: {first['msg']}; {_ALLOWED}"
        ) from error
    except KeyError as error:
        raise ScoreError(f"{path} is no blind score: {error} is missing; {_ALLOWED}") from error
    return score


_ALLOWED = "allowed: score.json of `bench blind score --out`"


def score_text(score: Mapping[str, Any]) -> str:
    """A score as JSON text, every figure and every row of a table on one line."""
    plain = {name: value for name, value in score.items() if name not in ("intervals", "tables")}
    lines = [f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in plain.items()]
    rows = [f"    {json.dumps(k)}: {json.dumps(v)}" for k, v in score["intervals"].items()]
    lines.append('  "intervals": {\n' + ",\n".join(rows) + "\n  }")
    tables = [
        f"    {json.dumps(name)}: [\n"
        + ",\n".join(f"      {json.dumps(row)}" for row in table)
        + "\n    ]"
        for name, table in score["tables"].items()
    ]
    lines.append('  "tables": {\n' + ",\n".join(tables) + "\n  }")
    return "{\n" + ",\n".join(lines) + "\n}\n"
