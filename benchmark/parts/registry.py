"""Plug-ins by name: those that stand here, and those of installed packages. Chosen only here.

Listing reads the text of files and imports nothing, so it needs no engine and no learner.
"""

import importlib
import re
from importlib import metadata
from pathlib import Path
from typing import Any

from benchmark.errors import CommandError, unknown
from benchmark.parts.extras import install_command
from files.plugins import KINDS, Part, parts

ROOT = Path(__file__).resolve().parents[2]


def names(kind: str) -> tuple[str, ...]:
    """Names of all plug-ins of a kind, as typed on the command line, sorted."""
    return tuple(parts(KINDS[kind]))


def usual(kind: str) -> tuple[str, ...]:
    """What 'all' stands for: `names`, less those whose class says `only_by_name = True`."""
    apart = re.compile(r"^    only_by_name = True$", re.MULTILINE)
    return tuple(name for name in names(kind) if not apart.search(part(kind, name).text))


def part(kind: str, name: str) -> Part:
    """Where a plug-in is; raises UsageError if it is unknown."""
    return parts(KINDS[kind])[check(kind, name)]


def scripted() -> tuple[str, ...]:
    """Names of the baselines that act without learning."""
    declares = re.compile(r"^class \w+\((?:\w+\.)?Scripted\)", re.MULTILINE)
    return tuple(name for name in names("algo") if declares.search(part("algo", name).text))


def check(kind: str, name: str) -> str:
    """`name` if it is known; else raises UsageError that suggests a similar name."""
    if name not in names(kind):
        raise unknown(kind, name, names(kind))
    return name


def chosen(kind: str, text: str) -> tuple[str, ...]:
    """The names between commas, each once ('all': `usual`); UsageError for an unknown one."""
    if text == "all":
        return usual(kind)
    return tuple(dict.fromkeys(check(kind, name.strip()) for name in text.split(",")))


def load(kind: str, name: str) -> Any:
    """The class or function of a plug-in; raises if it is unknown or its library is missing."""
    found = part(kind, name)
    try:
        return getattr(importlib.import_module(found.module), found.attribute)
    except AttributeError as error:
        raise CommandError(
            f"{kind} '{name}' of {found.package} cannot be loaded: {error}"
        ) from error
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        if (ROOT / missing).exists():
            raise
        raise CommandError(
            f"{kind} '{name}' needs the package '{missing}', which is not installed; "
            f"install it with: {installs(found)}"
        ) from error
    except ImportError as error:
        raise CommandError(
            f"{kind} '{name}' cannot be loaded: {error}; `bench doctor` says what is missing"
        ) from error


def installs(found: Part) -> str:
    """The command that installs what a plug-in needs."""
    if found.package is None:
        return install_command(found.module)
    needed = metadata.requires(found.package) or ()
    return f"pip install {' '.join(map(repr, needed)) or found.package}"
