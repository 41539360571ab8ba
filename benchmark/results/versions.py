"""Engines of other versions: each in a small environment of its own, over the packages of this one.

`python -m benchmark.results.versions` is what runs there: it evaluates one policy in one world, as
given on standard input, and writes its episodes.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from dataclasses import asdict
from pathlib import Path

from benchmark.console import say
from benchmark.errors import CommandError, UsageError
from benchmark.parts import registry
from benchmark.runs.evaluate import deploy, write_episodes
from benchmark.settings.run_spec import RunSpec

ROOT = Path(__file__).resolve().parents[2]
PYTHON, COMPILED = "bin/python", "compiled"
OVER = "over.pth"
"""Written last, it puts the packages of this environment behind those of the other."""


def home() -> Path:
    """Where the environments are."""
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "stickbench/versions"


def split(text: str) -> tuple[str, str]:
    """An engine and the version after an '@', empty for the installed one; raises UsageError."""
    name, _, version = text.strip().partition("@")
    registry.check("backend", name)
    if version and registry.part("backend", name).distribution is None:
        raise UsageError(f"{text}: this engine is no package that has versions; leave out '@'")
    return name, version


def environment(engine: str, version: str) -> Path:
    """The folder of an environment with an engine of this version; it is made if it is not there.

    Raises CommandError where there is no such version.
    """
    package = registry.part("backend", engine).distribution
    folder = home() / f"{package}-{version}"
    over = Path(sysconfig.get_path("purelib", vars={"base": str(folder)})) / OVER
    if over.exists():
        return folder
    say(f"{package} {version} is installed into {folder}")
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=False)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    words = [*pip, "--python", str(folder / PYTHON), "install", "--no-deps"]
    done = subprocess.run([*words, f"{package}=={version}"], capture_output=True, text=True)
    if done.returncode != 0:
        reason = done.stderr.strip().splitlines()[-1:] or ["pip failed"]
        shutil.rmtree(folder)
        raise CommandError(f"{package} {version} cannot be installed: {reason[0]}")
    packages = sysconfig.get_path("purelib")
    over.write_text(f"import site; site.addsitedir({packages!r})\n{ROOT}\n")
    return folder


def evaluate(
    spec: RunSpec, version: str, policy: Path, out: Path, *, episodes: int, seed: int, workers: int
) -> None:
    """Evaluate a policy where the world's engine has another version; writes its episodes to `out`.

    Raises CommandError where it cannot be run.
    """
    folder = environment(spec.backend, version)
    order = {
        "spec": asdict(spec),
        "policy": str(policy.resolve()),
        "out": str(out.resolve()),
        "options": {"episodes": episodes, "seed": seed, "workers": workers},
    }
    # Compiled code holds numbers of the engine's version.
    kept = os.environ | {"NUMBA_CACHE_DIR": str(folder / COMPILED)}
    words = [str(folder / PYTHON), "-m", "benchmark.results.versions"]
    done = subprocess.run(words, input=json.dumps(order), env=kept, capture_output=True, text=True)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise CommandError(f"{spec.backend} {version} cannot be run here: {lines[-1]}")


def main() -> None:
    """Do what standard input orders."""
    order = json.load(sys.stdin)
    found = deploy(RunSpec(**order["spec"]), Path(order["policy"]), **order["options"])
    write_episodes(found, Path(order["out"]))


if __name__ == "__main__":
    main()
