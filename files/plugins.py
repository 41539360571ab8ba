"""Parts by name: files of a package here, and what installed packages register for it.

A file that holds the class of a kind (of a hand: the function) is a part; its name is the file's.
A package of one's own registers a part by an entry point: `clover = "mine.clover:Task"` in the
group `stickbench.tasks`. Finding reads the text of files and imports no part, so it needs no engine
and no learner.
"""

import importlib.util
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

PREFIX = "stickbench."
"""Of the groups of entry points."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """Where a part is."""

    name: str
    module: str
    attribute: str
    """The class or function in the module."""
    package: str | None
    """The installed distribution that registers it; None: it stands here."""

    @property
    def text(self) -> str:
        """The source; empty where there is none, or where its package cannot be imported."""
        try:
            found = importlib.util.find_spec(self.module)
        except Exception:  # noqa: BLE001 - a package of others may raise anything
            return ""
        origin = found.origin if found else None
        return Path(origin).read_text() if origin and origin.endswith(".py") else ""

    @property
    def summary(self) -> str:
        """First line of the docstring of its module."""
        match = re.match(r'"""(.*?)(?:"""|\n)', self.text)
        return match.group(1) if match else ""

    @property
    def distribution(self) -> str | None:
        """The package whose version it depends on: `package = "..."` in its class, or its own.

        None where it needs nothing else.
        """
        named = re.search(r'^    package(?:: .*)? = "(.+)"$', self.text, re.MULTILINE)
        return named.group(1) if named else self.package


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of part."""

    home: str
    """Package of the files here."""
    attribute: str
    """The class, or the function, that makes a file of the home a part of this kind."""
    group: str
    """Group of entry points, without its prefix."""


KINDS = {
    "backend": Kind(home="backends", attribute="Backend", group="backends"),
    "task": Kind(home="tasks", attribute="Task", group="tasks"),
    "observation": Kind(home="tasks.observations", attribute="Observation", group="observations"),
    "algo": Kind(home="baselines", attribute="Baseline", group="algorithms"),
    "effect": Kind(home="backends.effects", attribute="Effect", group="effects"),
    "hand": Kind(home="backends", attribute="spec", group="hands"),
    "importer": Kind(home="diagnosis.importers", attribute="Importer", group="importers"),
}
"""By the words of the command line."""


@cache
def parts(kind: Kind) -> Mapping[str, Part]:
    """All parts of a kind by name, sorted; what stands here comes before what is registered."""
    found = {one.name: one for one in (*_registered(kind), *_files(kind))}
    return dict(sorted(found.items()))


def name_of(module: str) -> str:
    """The name of the part that a module holds."""
    return _names().get(module) or module.rpartition(".")[2].replace("_", "-")


@cache
def _names() -> Mapping[str, str]:
    """Names of registered parts by module."""
    return {point.value.partition(":")[0]: point.name for point in _points()}


@cache
def _points() -> tuple[metadata.EntryPoint, ...]:
    """What installed packages register here."""
    points = (point for one in metadata.distributions() for point in one.entry_points)
    return tuple(point for point in points if point.group.startswith(PREFIX))


def _files(kind: Kind) -> Iterator[Part]:
    declares = re.compile(rf"^(?:class|def) {kind.attribute}\b", re.MULTILINE)
    base = kind.home.rpartition(".")[2].rstrip("s") + ".py"
    home = importlib.util.find_spec(kind.home)
    for place in (home and home.submodule_search_locations) or ():
        for file in Path(place).glob("*.py"):
            if file.name != base and declares.search(file.read_text()):
                yield Part(
                    name=file.stem.replace("_", "-"),
                    module=f"{kind.home}.{file.stem}",
                    attribute=kind.attribute,
                    package=None,
                )


def _registered(kind: Kind) -> Iterator[Part]:
    for point in (p for p in _points() if p.group == PREFIX + kind.group):
        module, _, attribute = point.value.partition(":")
        yield Part(
            name=point.name,
            module=module,
            attribute=attribute or kind.attribute,
            package=point.dist.name if point.dist else module.partition(".")[0],
        )
