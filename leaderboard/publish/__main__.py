"""`python -m leaderboard.publish`: write every table and picture, or check them."""

import argparse
import sys
from pathlib import Path

from leaderboard.blind.score import ScoreError
from leaderboard.publish.files import PublishError, stale, write
from leaderboard.publish.kept import KeptError

ROOT = Path(__file__).resolve().parents[2]


def main(arguments: list[str]) -> int:
    """Run the command; its exit code."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.publish", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; 1 if one is stale")
    parser.add_argument("--root", type=Path, default=ROOT, help="the repository")
    given = parser.parse_args(arguments)
    try:
        found = stale(given.root) if given.check else write(given.root)
    except (PublishError, KeptError, ScoreError) as error:
        print(error, file=sys.stderr)
        return 1
    for line in found:
        print(line)
    if given.check and found:
        print(f"{len(found)} stale; write them with: make results", file=sys.stderr)
        return 1
    print("all up to date" if not found else f"{len(found)} written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
