"""`bench new` and `bench test`: a part of one's own, in a package of one's own, and its checks."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

from benchmark.errors import CommandError, UsageError, unknown
from benchmark.parts import registry
from benchmark.parts.extras import install_command
from files.plugins import KINDS, PREFIX

SUITES = {
    "backend": "test_backends.py",
    "task": "test_tasks.py",
    "observation": "test_observations.py",
    "effect": "test_effects_act.py",
    "algo": "test_algorithms.py",
}
"""Kinds of parts that `bench new` writes, and the file with the checks of each."""
_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_PROJECT = """[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "{name}"
version = "0.1.0"
dependencies = ["stickbench"]

[tool.setuptools]
packages = ["{package}"]
"""
_TEST = '''"""The {kind} '{name}' keeps the contract."""

import subprocess
import sys


def test_{module}():
    """Pass the checks of Stickbench; they print what fails."""
    subprocess.run([sys.executable, "-m", "benchmark", "test", "{name}"], check=True)
'''


def new(kind: str, name: str, folder: Path, package: str | None) -> dict:
    """Write a part with its test and its entry point into a package; what was written, what next.

    Raises UsageError for a name that is taken or is none, and where a file is in the way.
    """
    if not _NAME.fullmatch(name):
        raise UsageError(f"the name is '{name}'; allowed: small letters, such as long-lever")
    if name in registry.names(kind):
        raise UsageError(f"there is a {kind} named '{name}'; choose another name")
    package = package or re.sub(r"\W", "_", folder.resolve().name.lower())
    if not package.isidentifier() or (registry.ROOT / package).exists():
        raise UsageError(
            f"--package is '{package}'; allowed: a name of Python, none of Stickbench's"
        )
    module = name.replace("-", "_")
    template = Path(__file__).parent / "templates" / f"{kind}.txt"
    files = {
        folder / package / f"{module}.py": template.read_text().replace("NAME", name),
        folder / "tests" / f"test_{module}.py": _TEST.format(kind=kind, name=name, module=module),
    }
    if there := [str(path) for path in files if path.exists()]:
        raise UsageError(f"{there[0]} exists; choose another name, or remove it")
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / package / "__init__.py").touch()
    _register(folder / "pyproject.toml", kind, name, f"{package}.{module}", package)
    return {
        "written": [str(path) for path in (*files, folder / "pyproject.toml")],
        "next": f"pip install -e {folder}; bench test {name}",
    }


def _register(project: Path, kind: str, name: str, module: str, package: str) -> None:
    """Add the entry point to a project file, which is made where there is none."""
    if not project.exists():
        project.write_text(_PROJECT.format(name=package.replace("_", "-"), package=package))
    of = KINDS[kind]
    head = f'[project.entry-points."{PREFIX}{of.group}"]\n'
    line = f'{name} = "{module}:{of.attribute}"\n'
    text = project.read_text()
    before, found, after = text.partition(head)
    project.write_text(f"{before}{head}{line}{after}" if found else f"{text}\n{head}{line}")


def check(name: str) -> dict:
    """Run the checks of the part of that name, whatever its kind; raises CommandError."""
    kinds = [kind for kind in SUITES if name in registry.names(kind)]
    if not kinds:
        known = [known for kind in SUITES for known in registry.names(kind)]
        raise unknown("part", name, known)
    if importlib.util.find_spec("pytest") is None:
        raise CommandError(f"the checks need pytest; install it with: {install_command('test')}")
    suites = [str(_folder() / SUITES[kind]) for kind in kinds]
    options = ["-q", "-rs", "--only", name, "-p", "no:cacheprovider"]
    done = subprocess.run([sys.executable, "-m", "pytest", *options, *suites], stdout=sys.stderr)
    return {"ok": done.returncode == 0, "part": name, "kinds": kinds}


def _folder() -> Path:
    """Where the suites are: in the source, or in the installed package."""
    source = registry.ROOT / "tests" / "conformance"
    return source if source.exists() else registry.ROOT / "benchmark" / "conformance"
