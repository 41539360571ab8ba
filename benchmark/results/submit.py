"""`bench submit`: rows and policies for a board, as a folder that it can check and replay.

OUT/submission.json      what it is: rows, the program that made it, SHA-256 of every other file
OUT/policies/NAME/       a finished run each: policy, contract, episodes, card, row
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from baselines.saved import file_sha256
from benchmark.errors import CommandError, UsageError
from benchmark.provenance import provenance
from benchmark.results.keep import keep_policies
from benchmark.results.verify import SUBMISSION_FILE, verify
from benchmark.runs.run_folder import read_run
from files.atomic import write_atomically
from leaderboard.identity import row_key

POLICIES = "policies"


def submit(runs: Sequence[Path], out: Path, workers: int | None) -> tuple[dict, Table]:
    """Write finished policies to `out`, each replayed first; an earlier submission is replaced.

    Raises UsageError where there is none, or `out` is something else; CommandError where a row
    does not repeat.
    """
    if out.exists() and not (out / SUBMISSION_FILE).exists() and any(out.iterdir()):
        raise UsageError(f"{out} holds no submission; choose another --out, so nothing is lost")
    if missing := [str(run) for run in runs if not run.exists()]:
        raise UsageError(f"no folder at {', '.join(missing)}")
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{out.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    names = keep_policies(runs, part / POLICIES)
    if not names:
        raise UsageError(
            f"no finished policy in {', '.join(map(str, runs))}; smoke runs and scripted baselines "
            "have no place on the board"
        )
    found, table = verify([part], None, None, workers)
    if found["failed"]:
        shutil.rmtree(part)
        reasons = "; ".join(f"{Path(f['run']).name}: {f['reason']}" for f in found["failed"])
        raise CommandError(f"not written, for these do not repeat their rows: {reasons}")
    _seal(part, names)
    shutil.rmtree(out, ignore_errors=True)
    part.rename(out)
    return {"status": "done", "dir": str(out), "rows": len(names), "exact": found["exact"]}, table


def _seal(folder: Path, names: Sequence[str]) -> None:
    """Write what the submission holds, and the digest of every file."""
    rows = {name: read_run(folder / POLICIES / name) for name in names}
    said = {
        "schema": 1,
        "rows": {
            name: row_key(row["digest"], row["policy_sha256"], row["scores"])
            for name, row in rows.items()
        },
        "provenance": provenance(),
        "files": {
            str(file.relative_to(folder)): file_sha256(file)
            for file in sorted(folder.rglob("*"))
            if file.is_file()
        },
    }
    write_atomically(folder / SUBMISSION_FILE, json.dumps(said, indent=2) + "\n")
