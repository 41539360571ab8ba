"""Pictures in which a policy is replayed: `python -m leaderboard.publish.figures` draws them.

Only `bench view` can draw them, so this file knows their commands and not how it is done. What
each was drawn from stands in a manifest, so that a test can tell a stale picture without an engine.
"""

import argparse
import hashlib
import json
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from leaderboard._whole import write_whole

PLAN, MANIFEST = "leaderboard/figures.yaml", "leaderboard/figures.json"
POLICIES = "leaderboard/policies"
INPUTS = ("run.json", "contract.json", "policy.onnx")
"""Files of a policy's folder that a picture depends on."""
FOLDER = "leaderboard/figures"
"""Holds nothing but such pictures."""
ROOT = Path(__file__).resolve().parents[2]


def wrong(root: Path) -> list[str]:
    """What is wrong with each picture that is not as the plan and its policy have it."""
    plan, manifest = _plan(root), _manifest(root)
    found = [
        f"{picture}: {reason}; make figures"
        for picture, entry in plan.items()
        if (reason := _reason(root, picture, entry, manifest.get(picture)))
    ]
    kept = {path.relative_to(root).as_posix() for path in (root / FOLDER).glob("*")}
    return found + [
        f"{picture}: not in {PLAN}" for picture in sorted((kept | set(manifest)) - set(plan))
    ]


def draw(root: Path, everything: bool = False) -> list[str]:
    """Draw the pictures that are stale, or all, and write the manifest; what was drawn."""
    plan, manifest = _plan(root), _manifest(root)
    drawn = []
    for picture, entry in plan.items():
        if everything or _reason(root, picture, entry, manifest.get(picture)):
            print(_command(picture, entry), file=sys.stderr)
            subprocess.run([_bench(), *_arguments(picture, entry)], check=True, cwd=root)
            drawn.append(picture)
    made = {
        picture: {**_inputs(root, picture, entry), "sha256": _sha256(root / picture)}
        for picture, entry in sorted(plan.items())
    }
    write_whole(root / MANIFEST, (json.dumps(made, indent=2) + "\n").encode())
    return drawn


def _reason(
    root: Path, picture: str, entry: Mapping[str, str], before: Mapping[str, Any] | None
) -> str:
    """Why a picture has to be drawn; empty if it has not."""
    if not (root / picture).exists():
        return "missing"
    if before is None:
        return f"not in {MANIFEST}"
    if before["sha256"] != _sha256(root / picture):
        return "not the picture that was drawn"
    now = _inputs(root, picture, entry)
    changed = [name for name, value in now.items() if before.get(name) != value]
    return f"{' and '.join(changed)} changed since it was drawn" if changed else ""


def _inputs(root: Path, picture: str, entry: Mapping[str, str]) -> dict[str, Any]:
    """What a picture follows from: its command, and the digest of its policy's files."""
    folder = root / POLICIES / entry["policy"]
    digest = hashlib.sha256()
    for name in INPUTS:
        digest.update((folder / name).read_bytes())
    return {"command": _command(picture, entry), "policy_sha256": digest.hexdigest()}


def _command(picture: str, entry: Mapping[str, str]) -> str:
    return shlex.join(["bench", *_arguments(picture, entry)])


def _arguments(picture: str, entry: Mapping[str, str]) -> list[str]:
    options = shlex.split(entry.get("options", ""))
    return ["view", f"{POLICIES}/{entry['policy']}", *options, "--out", picture]


def _bench() -> str:
    """The command of the environment that this runs in."""
    found = shutil.which("bench", path=str(Path(sys.executable).parent)) or shutil.which("bench")
    if found is None:
        raise SystemExit("no bench command here; install Stickbench with: make install")
    return found


def _plan(root: Path) -> dict[str, dict[str, str]]:
    return yaml.safe_load((root / PLAN).read_text(encoding="utf-8"))


def _manifest(root: Path) -> dict[str, dict[str, Any]]:
    path = root / MANIFEST
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main(arguments: list[str]) -> int:
    """Run the command; its exit code."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.publish.figures")
    parser.add_argument("--all", action="store_true", help="draw those that are not stale, too")
    parser.add_argument("--root", type=Path, default=ROOT, help="the repository")
    given = parser.parse_args(arguments)
    drawn = draw(given.root, given.all)
    print(f"{len(drawn)} drawn; now: make results" if drawn else "all up to date", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
