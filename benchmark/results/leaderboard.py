"""`bench leaderboard`: the tables of finished runs, and what is kept of them."""

from collections.abc import Sequence
from pathlib import Path

from benchmark.errors import CommandError
from benchmark.results.keep import keep_policies, keep_rows
from benchmark.runs.run_folder import RUNS
from leaderboard.files import write
from leaderboard.rows import read_rows
from leaderboard.tables import board
from leaderboard.verified import read_verified

LEADERBOARD, POLICIES = Path("leaderboard"), "policies"


def _marks(out: Path) -> dict[str, dict]:
    """Which rows of a leaderboard were verified; raises CommandError where that is damaged."""
    try:
        return read_verified(out)
    except (OSError, ValueError) as error:
        raise CommandError(
            f"{error}; remove the file, and `bench verify` makes it again"
        ) from error


def leaderboard(
    sources: Sequence[Path],
    out: Path | None,
    add: bool,
    policies: bool,
    html: bool,
    include_smoke: bool,
) -> dict:
    """Write the leaderboard's files; returns what was written and what could not be read.

    `add` copies the rows of the sources there, `policies` their policies.
    """
    out = out or LEADERBOARD
    results = out / "results"
    kept_rows = [results] if any(results.glob("*.json")) else []
    given = [*sources] or ([] if kept_rows and not (add or policies) else [RUNS])
    sources = [*given, *kept_rows]
    rows, problems = read_rows(sources)
    smoke = [row for row in rows if row.spec.smoke]
    if not include_smoke:
        rows = [row for row in rows if not row.spec.smoke]
    if not rows:
        left = f"{len(smoke)} smoke runs; --include-smoke shows them" if smoke else ""
        found = "; ".join(filter(None, [left, *problems])) or "no run.json was found"
        where = ", ".join(map(str, sources))
        raise CommandError(f"nothing to rank in {where}: {found}")
    if add:
        keep_rows(given, results)
    kept = keep_policies(given, out / POLICIES) if policies else []
    made = board(rows, problems, smoke=include_smoke, verified=_marks(out))
    files = [str(file) for file in write(made, out, html)]
    return {
        "status": "done",
        "rows": len(rows),
        "smoke_left_out": 0 if include_smoke else len(smoke),
        "policies": len(kept),
        "written": files,
        "problems": problems,
    }
