"""`python -m leaderboard.blind add SCORE`: a new score into the repository."""

import argparse
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from leaderboard.blind.add import add
from leaderboard.blind.history import DATE, HISTORY_FILE
from leaderboard.blind.score import ScoreError

FOLDER = Path(__file__).parent


def main(arguments: list[str]) -> int:
    """Run the command; its exit code."""
    given = _parser().parse_args(arguments)
    try:
        commit = given.commit or _head()
        options = {"commit": commit, "name": given.name, "pool": given.pool}
        line = add(given.score, given.folder, date=given.date, **options)
    except ScoreError as error:
        print(error, file=sys.stderr)
        return 2
    shown = "shown as the latest of its kind" if line.blind else "a tuning set: not shown"
    print(f"added {line.name} to {given.folder / HISTORY_FILE}, {shown}; now: make results")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m leaderboard.blind", description=__doc__)
    command = parser.add_subparsers(required=True).add_parser(
        "add", help="take score.json of `bench blind score --out` into the history"
    )
    command.add_argument("score", type=Path, help="score.json of `bench blind score --out`")
    command.add_argument("--name", help="name of the set (default: what it is of, and the day)")
    command.add_argument("--commit", help="commit of the solver (default: HEAD)")
    command.add_argument(
        "--date", type=_date, default=datetime.now(UTC).replace(tzinfo=None), help="default: now"
    )
    command.add_argument(
        "--pool",
        action="store_true",
        help="count together with the latest set of this kind, which the same solver solved",
    )
    command.add_argument("--folder", type=Path, default=FOLDER, help=argparse.SUPPRESS)
    return parser


def _date(text: str) -> datetime:
    return datetime.strptime(text, DATE)


def _head() -> str:
    """The commit that is checked out."""
    command = ["git", "-C", str(FOLDER), "rev-parse", "--short=9", "HEAD"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise ScoreError("no commit is known here; say --commit") from error
    return found.stdout.strip()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
