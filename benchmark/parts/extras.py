"""Which command installs what a part of Stickbench needs and is not there.

An extra of the package bears a word of the name of what needs it: an engine's file, or a folder.
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
    named = [word for word in re.split(r"[._/]", module) if word in _extras()]
    extra = f"[{named[0]}]" if named else ""
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
