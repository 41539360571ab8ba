"""Plug-ins by name: files that hold one class of a kind. They are chosen only here.

Listing reads the text of files and imports nothing, so it needs no engine and no learner.
"""

import importlib
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.errors import CommandError, unknown
from benchmark.extras import install_command

ROOT = Path(__file__).resolve().parent.parent
_KINDS = {
    "backend": ("backends", "Backend"),
    "task": ("tasks", "Task"),
    "observation": ("tasks/observations", "Observation"),
    "algo": ("baselines", "Baseline"),
    "effect": ("backends/effects", "Effect"),
    "importer": ("diagnosis/importers", "Importer"),
}
KINDS = tuple(_KINDS)


@cache
def names(kind: str) -> tuple[str, ...]:
    """Names of all plug-ins of a kind, as typed on the command line, sorted."""
    folder, class_name = _KINDS[kind]
    declares = re.compile(rf"^class {class_name}\b", re.MULTILINE)
    base_file = folder.split("/")[-1].rstrip("s") + ".py"
    files = (file for place in _places(folder) for file in place.glob("*.py"))
    found = [f.stem for f in files if f.name != base_file and declares.search(f.read_text())]
    return tuple(sorted(name.replace("_", "-") for name in found))


def _places(folder: str) -> Iterator[Path]:
    """The directories of a package."""
    found = importlib.util.find_spec(folder.replace("/", "."))
    return map(Path, (found and found.submodule_search_locations) or ())


def summary(kind: str, name: str) -> str:
    """First line of the plug-in's module docstring."""
    places = (place / f"{_module(name)}.py" for place in _places(_KINDS[kind][0]))
    text = next(file for file in places if file.exists()).read_text()
    match = re.match(r'"""(.*?)(?:"""|\n)', text)
    return match.group(1) if match else ""


def check(kind: str, name: str) -> str:
    """`name` if it is known; else raises UsageError that suggests a similar name."""
    if name not in names(kind):
        raise unknown(kind, name, names(kind))
    return name


def chosen(kind: str, text: str) -> tuple[str, ...]:
    """The names between commas, each once ('all': all of them); UsageError for an unknown one."""
    if text == "all":
        return names(kind)
    return tuple(dict.fromkeys(check(kind, name.strip()) for name in text.split(",")))


def module_of(kind: str, name: str) -> str:
    """The module that holds a plug-in."""
    return f"{_KINDS[kind][0].replace('/', '.')}.{_module(name)}"


def load(kind: str, name: str) -> Any:
    """The class of a plug-in; raises if it is unknown or its library is missing."""
    module = module_of(kind, check(kind, name))
    try:
        return getattr(importlib.import_module(module), _KINDS[kind][1])
    except ModuleNotFoundError as error:
        missing = (error.name or "").split(".")[0]
        if (ROOT / missing).exists():
            raise
        raise CommandError(
            f"{kind} '{name}' needs the package '{missing}', which is not installed; "
            f"install it with: {install_command(module)}"
        ) from error
    except ImportError as error:
        raise CommandError(
            f"{kind} '{name}' cannot be loaded: {error}; `bench doctor` says what is missing"
        ) from error


def _module(name: str) -> str:
    return name.replace("-", "_")
