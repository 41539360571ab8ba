"""The wheel of what git has, which needs no checkout."""

import shutil
import subprocess
import sys
from pathlib import Path

from benchmark.parts.registry import ROOT

BESIDE = ("leaderboard/leaderboard.", "leaderboard/policies", "leaderboard/results")
BESIDE += ("leaderboard/figures", "leaderboard/transfer", "leaderboard/blind/history.csv")
BESIDE += ("leaderboard/blind/scores", "leaderboard/physics.json", "leaderboard/speed.json")
BESIDE += ("leaderboard/verified.json",)
"""Results, which the package does not need."""


def tracked() -> list[str]:
    """Files that git knows or would take up, but results."""
    command = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")
    return [n for n in listed if n and not n.startswith(BESIDE) and (ROOT / n).is_file()]


def make_wheel(source: Path, out: Path) -> Path:
    """Make the wheel from a copy of the files in `source`; returns it, in `out`."""
    for name in tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, source / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(out)]
    subprocess.run([*command, str(source)], check=True)
    return next(out.glob("*.whl"))
