"""A new score into the history and among the latest scores."""

import json
from datetime import datetime
from pathlib import Path

from leaderboard._whole import write_whole
from leaderboard.blind.history import (
    HISTORY_FILE,
    SCORES,
    Line,
    history_text,
    line_of,
    read_history,
)
from leaderboard.blind.score import Kind, Score, ScoreError, read_score, score_text


def add(
    path: Path,
    folder: Path,
    *,
    commit: str,
    date: datetime,
    name: str | None = None,
    pool: bool = False,
) -> Line:
    """Take a score into the folder of the blind sets; its line in the history.

    It supersedes the latest scores of its kind, or with `pool` counts together with them. The
    score of a tuning set goes into the history alone. Raises ScoreError.
    """
    score, date = read_score(path), date.replace(second=0, microsecond=0)
    before = read_history(folder) if (folder / HISTORY_FILE).exists() else []
    names = {line.name for line in before}
    if name in names:
        raise ScoreError(f"there is a set '{name}'; choose another --name")
    new = line_of(score, name or _free_name(score.kind, date, names), date, commit)
    for line in before:
        if line.content == new.content:
            raise ScoreError(f"{path} is there already, as '{line.name}'")
    if score.frozen:
        _keep(path, new, folder / SCORES, pool)
    write_whole(folder / HISTORY_FILE, history_text([*before, new]).encode())
    return new


def latest(folder: Path) -> dict[Kind, dict[str, Score]]:
    """The latest scores by their kind, and in it by name."""
    found: dict[Kind, dict[str, Score]] = {}
    for path in sorted((folder / SCORES).glob("*.json")):
        score = read_score(path)
        found.setdefault(score.kind, {})[path.stem] = score
    return found


def _keep(path: Path, new: Line, scores: Path, pool: bool) -> None:
    superseded = [] if pool else list(latest(scores.parent).get(new.kind, ()))
    text = score_text(json.loads(path.read_bytes()))
    write_whole(scores / f"{new.name}.json", text.encode())
    for name in superseded:
        (scores / f"{name}.json").unlink()


def _free_name(kind: Kind, date: datetime, taken: set[str]) -> str:
    """A name that says what the set is of, with a number where it is not the day's first."""
    parts = [kind.rig, *([kind.modes] if kind.modes != "all" else [])]
    parts += [*kind.sides] if len(kind.sides) < 3 else []
    parts += ["healthy"] if kind.healthy else []
    stem = "-".join([*parts, date.strftime("%Y-%m-%d")])
    numbered = (f"{stem}-{number}" for number in range(2, len(taken) + 3))
    return next(name for name in (stem, *numbered) if name not in taken)
