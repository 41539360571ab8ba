"""`bench verify`: policies replayed, and their scores held against what their rows say."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table

from baselines.saved import file_sha256
from benchmark.console import say
from benchmark.errors import CommandError, UsageError
from benchmark.provenance import provenance, usable_cores
from benchmark.runs import run_folder
from benchmark.runs.evaluate import Episodes, deploy
from benchmark.runs.run_folder import EPISODES_FILE, RUN_FILE
from files.atomic import write_atomically
from files.bounded import read_json
from files.tables import read_parquet
from leaderboard.identity import row_key
from leaderboard.rows import read_rows
from leaderboard.verified import VERIFIED_FILE, read_verified, verified_text

POLICIES = Path("leaderboard/policies")
SUBMISSION_FILE = "submission.json"
SCORES = ("tracked", "held", "p_err_cm", "q_err_deg")
DEVIATIONS = 4.0
"""Of the mean over episodes: another processor rounds otherwise, and contact amplifies it; beyond
this the scores are others."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a replay says of one row."""

    folder: Path
    state: str
    """exact, close (within what rounding explains), differs, or refused."""
    reason: str = ""
    key: str = ""
    """What the row claims."""

    @property
    def good(self) -> bool:
        """Whether the row is verified."""
        return self.state in ("exact", "close")


def verify(
    sources: Sequence[Path], sample: int | None, out: Path | None, workers: int | None
) -> tuple[dict, Table]:
    """Replay every policy in the sources, or `sample` of them spread evenly; what was found.

    With `out`, a leaderboard's folder, rows that hold are marked there. Files of a submission must
    be those that were submitted.
    """
    folders = list(_folders(sources or [POLICIES]))
    if not folders:
        raise UsageError(f"no finished run in {', '.join(map(str, sources))}")
    changed = {path for source in sources for path in _changed(source)}
    if strange := sorted(str(path) for path in changed if path.parent not in folders):
        raise UsageError(f"not as submitted: {', '.join(strange[:5])}; take it as it was written")
    if sample is not None and sample < len(folders):
        chosen = np.linspace(0, len(folders) - 1, sample).round().astype(int)
        folders = [folders[k] for k in chosen]
    verdicts = []
    for number, folder in enumerate(folders, 1):
        other = sorted(path.name for path in changed if path.parent == folder)
        verdicts.append(
            Verdict(folder=folder, state="refused", reason=f"not as submitted: {', '.join(other)}")
            if other
            else _verdict(folder, workers or usable_cores())
        )
        say(f"{number}/{len(folders)} {folder.name}: {verdicts[-1].state} {verdicts[-1].reason}")
        if out is not None and verdicts[-1].good:
            _mark(verdicts[-1], out)
    table = Table("run", "state", "reason", header_style="bold")
    for one in verdicts:
        table.add_row(one.folder.name, one.state, one.reason)
    bad = [one for one in verdicts if not one.good]
    return {
        "status": "failed" if bad else "done",
        "rows": len(verdicts),
        "verified": len(verdicts) - len(bad),
        "exact": sum(one.state == "exact" for one in verdicts),
        "failed": [{"run": str(one.folder), "reason": one.reason} for one in bad],
    }, table


def _folders(sources: Sequence[Path]) -> Iterator[Path]:
    for source in sources:
        if not source.exists():
            raise UsageError(f"no folder at {source}")
        yield from sorted(file.parent for file in source.rglob(RUN_FILE))


def _changed(source: Path) -> Iterator[Path]:
    """Files of a submission that are not those that it names; none of another folder."""
    manifest = source / SUBMISSION_FILE
    if not manifest.exists():
        return
    try:
        named = dict(read_json(manifest)["files"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{manifest} is no list of a submission's files: {error}") from error
    there = {str(p.relative_to(source)) for p in source.rglob("*") if p.is_file()}
    for name in sorted({*named, *there} - {SUBMISSION_FILE}):
        if name not in there or file_sha256(source / name) != named.get(name):
            yield source / name


def _verdict(folder: Path, workers: int) -> Verdict:
    try:
        row = run_folder.finished_run(folder)
        _, problems = read_rows([folder / RUN_FILE])
        if problems:
            return Verdict(folder=folder, state="refused", reason=problems[0])
        spec = run_folder.run_spec(row)
        if row["spec_digest"] != spec.world().digest:
            reason = "its spec_digest is not that of its hand, stick and effects"
            return Verdict(folder=folder, state="refused", reason=reason)
        kept = read_parquet(folder / EPISODES_FILE)
        if reason := _other_than(row["scores"], kept):
            return Verdict(folder=folder, state="differs", reason=reason)
        again = deploy(spec, folder, workers, episodes=row["scores"]["episodes"])
    except (CommandError, OSError, ValueError, KeyError, TypeError) as error:
        return Verdict(folder=folder, state="refused", reason=str(error))
    key = row_key(row["digest"], row["policy_sha256"], row["scores"])
    state, reason = _compared(row["scores"], kept, again)
    return Verdict(folder=folder, state=state, reason=reason, key=key)


def _other_than(said: dict, kept: pd.DataFrame) -> str:
    """The score that is not the mean of the kept episodes; empty where all are."""
    for name in SCORES:
        mean = kept[name].mean()
        if not math.isclose(mean, said[name], rel_tol=1e-9, abs_tol=1e-12):
            return f"{name} is {said[name]:.4g}; its episodes have {mean:.4g}"
    return ""


def _compared(said: dict, kept: pd.DataFrame, again: Episodes) -> tuple[str, str]:
    """Whether the kept episodes are those that were replayed, or close."""
    exact = True
    for name in SCORES:
        values = getattr(again, name)
        spread = math.hypot(kept[name].std(), values.std()) / math.sqrt(len(values))
        if abs(values.mean() - said[name]) > DEVIATIONS * max(spread, 1e-9):
            return "differs", f"{name} is {said[name]:.4g}; replayed {values.mean():.4g}"
        exact = exact and bool(np.array_equal(values, kept[name]))
    return ("exact" if exact else "close"), ""


def _mark(one: Verdict, out: Path) -> None:
    """Add a row's mark to the leaderboard's file."""
    made = provenance()
    out.mkdir(parents=True, exist_ok=True)
    marks = read_verified(out)
    marks[one.key] = {
        "run": one.folder.name,
        "state": one.state,
        **{name: made[name] for name in ("cpu", "commit", "finished")},
    }
    write_atomically(out / VERIFIED_FILE, verified_text(marks))
