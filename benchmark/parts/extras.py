"""Which command installs what a part of Stickbench needs and is not there.

An extra of the package bears the name of what needs it: an engine's file, or a folder of files.
"""

import re
import tomllib
from functools import cache
from importlib import metadata
from pathlib import Path

NAME = "stickbench"
_PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"
"""Only in a checkout."""


def install_command(module: str) -> str:
    """How to install Stickbench with all that a module such as `backends.bullet` imports."""
    named = [part for part in re.split(r"[./]", module) if part.replace("_", "-") in _extras()]
    extra = f"[{named[0].replace('_', '-')}]" if named else ""
    if _PROJECT.exists():
        return f"pip install -c constraints.txt -e '.{extra}'"
    return f"pip install '{NAME}{extra}'"


@cache
def _extras() -> tuple[str, ...]:
    """Names of the extras: of a checkout as its project file has them now, else as installed."""
    if _PROJECT.exists():
        project = tomllib.loads(_PROJECT.read_text())["project"]
        return tuple(project["optional-dependencies"])
    try:
        return tuple(metadata.metadata(NAME).get_all("Provides-Extra") or ())
    except metadata.PackageNotFoundError:
        return ()
