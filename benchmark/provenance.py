"""Provenance of a result: command, versions, CPU, commit."""

import os
import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from benchmark.parts import registry

_BESIDE = ("gymnasium", "torch", "numpy", "numba", "onnxruntime", "pandas")
"""Packages that can change a result, besides those of engines and learners."""
_MADE_BY = ("backend", "algo")
"""Kinds of parts whose packages decide a result."""
_ROOT = Path(__file__).resolve().parent.parent


def version(package: str) -> str | None:
    """Installed version of a package, or None; imports nothing."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def provenance() -> dict:
    """The provenance that a result row contains."""
    return {
        "command": shlex.join(["bench", *sys.argv[1:]]),
        "versions": {p: v for p in _packages() if (v := version(p)) is not None},
        "python": platform.python_version(),
        "cpu": _cpu(),
        "cores": usable_cores(),
        "commit": _commit(),
        "platform": platform.platform(),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _packages() -> tuple[str, ...]:
    """Packages of every engine and learner, and those beside them."""
    parts = (registry.part(kind, name) for kind in _MADE_BY for name in registry.names(kind))
    of_parts = [part.distribution for part in parts]
    return tuple(dict.fromkeys([*filter(None, of_parts), *_BESIDE]))


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration, IndexError):
        return platform.processor() or "unknown"


def _commit() -> str:
    if not (_ROOT / ".git").exists():  # an installed copy may lie in somebody else's repository
        return "unknown"

    def git(*words: str) -> str:
        try:
            done = subprocess.run(
                ["git", "-C", str(_ROOT), *words], capture_output=True, text=True, check=False
            )
        except OSError:  # git is not installed
            return ""
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = git("rev-parse", "--short=12", "HEAD")
    if not commit:
        return "unknown"
    return f"{commit}+changes" if git("status", "--porcelain", "--untracked-files=no") else commit
