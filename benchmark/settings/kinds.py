"""Options, each declared once: name, kind, default and help, and the field that it sets.

An option is a field of a dataclass, of `RunSpec` or of what a command asks, or the annotation of a
command's parameter. Command line, environment variables, grid file, docs, Python face and checks
are made from it. Its kind says how a value is read, bounded and shown.
"""

import math
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from typing import Any, Protocol

from benchmark.errors import UsageError, unknown
from benchmark.parts import registry
from benchmark.settings import quantities


class Kind(Protocol):
    """A kind of value."""

    @property
    def metavar(self) -> str:
        """Placeholder for a value in the help."""
        ...

    @property
    def allowed(self) -> str:
        """The allowed values, for the help; empty if the help text lists them."""
        ...

    def read(self, given: object, flag: str) -> Any:
        """Read a value that is given as text or plain data; raises UsageError that names `flag`."""
        ...

    def show(self, value: Any) -> str:
        """The value as a user types it."""
        ...


@dataclass(frozen=True)
class Name:
    """The name of a plug-in."""

    kind: str
    metavar: str = "NAME"

    @property
    def completed_by(self) -> str:
        """See `Text.completed_by`."""
        return self.kind

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return ", ".join(registry.names(self.kind))

    def read(self, given: object, flag: str) -> str:
        """See `Kind.read`."""
        return registry.check(self.kind, str(given))

    def show(self, value: str) -> str:
        """See `Kind.show`."""
        return value


@dataclass(frozen=True)
class Choice:
    """One of several names."""

    what: str
    known: tuple[str, ...]
    metavar: str = "NAME"

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return ", ".join(self.known)

    def read(self, given: object, flag: str) -> str:
        """See `Kind.read`."""
        if given not in self.known:
            raise unknown(self.what, str(given), self.known)
        return str(given)

    def show(self, value: str) -> str:
        """See `Kind.show`."""
        return value


@dataclass(frozen=True)
class Text:
    """Text that is interpreted later."""

    metavar: str
    allowed: str = ""
    completed_by: str = ""
    """Kind of plug-ins whose names may stand in it."""

    def read(self, given: object, flag: str) -> str:
        """See `Kind.read`."""
        return str(given)

    def show(self, value: str) -> str:
        """See `Kind.show`."""
        return value


@dataclass(frozen=True)
class File:
    """A file or folder."""

    metavar: str
    allowed: str = ""

    def read(self, given: object, flag: str) -> Path:
        """See `Kind.read`."""
        return Path(str(given))

    def show(self, value: Path) -> str:
        """See `Kind.show`."""
        return str(value)


@dataclass(frozen=True)
class Number:
    """A number within bounds; a whole number may be written as 2e6."""

    low: float
    high: float = math.inf
    unit: str = ""
    """Unit of the bounds and of the typed value; empty: a number without unit."""
    whole: bool = False

    @property
    def metavar(self) -> str:
        """Placeholder for the number."""
        units = {"cm": "LENGTH", "mm": "LENGTH", "s": "TIME", "Hz": "RATE"}
        return units.get(self.unit, "N" if self.whole else "X")

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        if self.high == math.inf:
            return f"from {_plain(self.low)}{self._unit}"
        return f"{_plain(self.low)} to {_plain(self.high)}{self._unit}"

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""

    def read(self, given: object, flag: str) -> float:
        """See `Kind.read`; plain numbers are in SI units."""
        value = self._value(given, flag)
        size = quantities.size(self.unit) if self.unit else 1.0
        shown = value / size
        if not (math.isfinite(shown) and self.low * (1 - 1e-12) <= shown <= self.high):
            raise UsageError(f"{flag} is {shown:g}{self._unit}; allowed: {self.allowed}")
        return value

    def _value(self, given: object, flag: str) -> float:
        if not isinstance(given, str):
            if isinstance(given, bool) or not isinstance(given, int | float):
                raise UsageError(f"{flag} is {given!r}; allowed: a number")
            return int(given) if self.whole and given == int(given) else float(given)
        if self.whole:
            return quantities.count(given, flag)
        if self.unit:
            return quantities.quantity(given, flag, self.unit)
        return quantities.number(given, flag)

    def show(self, value: float) -> str:
        """See `Kind.show`."""
        size = quantities.size(self.unit) if self.unit else 1.0
        return f"{_plain(value / size)}{self.unit}"


@dataclass(frozen=True)
class Counts:
    """Whole numbers between commas, each once, the smallest first."""

    each: Number
    metavar: str = "NUMBERS"

    @property
    def allowed(self) -> str:
        """See `Kind.allowed`."""
        return self.each.allowed

    def read(self, given: object, flag: str) -> tuple[int, ...]:
        """See `Kind.read`."""
        found = {int(self.each.read(part.strip(), flag)) for part in str(given).split(",")}
        return tuple(sorted(found))

    def show(self, value: tuple[int, ...]) -> str:
        """See `Kind.show`."""
        return ",".join(map(str, value))


@dataclass(frozen=True)
class Span:
    """Two numbers above 0, the lower one first."""

    metavar: str = "LOW:HIGH"
    allowed: str = ""

    def read(self, given: object, flag: str) -> tuple[float, float]:
        """See `Kind.read`."""
        return quantities.span(str(given), flag)

    def show(self, value: tuple[float, float]) -> str:
        """See `Kind.show`."""
        return ":".join(map(_plain, value))


def _plain(value: float) -> str:
    """A number as a user types it: 1e6, 0.05."""
    text = f"{value:g}" if float(f"{value:g}") == value else f"{value:.12g}"
    return text.replace("e+0", "e").replace("e+", "e")


@dataclass(frozen=True)
class Switch:
    """Yes or no: on the command line --NAME, and --no-NAME if it is on by default."""

    metavar: str = ""
    allowed: str = ""

    def read(self, given: object, flag: str) -> bool:
        """See `Kind.read`."""
        if not isinstance(given, bool):
            raise UsageError(f"{flag} is {given!r}; allowed: true or false")
        return given

    def show(self, value: bool) -> str:
        """See `Kind.show`."""
        return "yes" if value else "no"


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One option: its name on the command line and the field that it sets."""

    name: str = ""
    """Name on the command line, without its dashes; empty: that of the parameter."""
    field: str = ""
    """Field of the dataclass, or parameter."""
    kind: Kind
    help: str
    default: Any = ...
    """An ellipsis if a value must be given."""
    alias: str | None = None
    """Another name on the command line."""
    letter: str = ""
    """Its short form, without its dash."""
    shown: str | None = None
    """The default in words."""
    of: str = ""
    """What it decides, such as WORLD."""
    argument: bool = False
    """Given without its name."""
    many: bool = False
    """Repeatable: a tuple of values."""

    @property
    def names(self) -> tuple[str, ...]:
        """Every name under which it may be given, in the form of a Python name."""
        names = (self.name, self.alias or self.name, self.field)
        return tuple(dict.fromkeys(name.replace("-", "_") for name in names))

    @property
    def flag(self) -> str:
        """As on the command line."""
        return f"--{self.name}"

    @property
    def flags(self) -> tuple[str, ...]:
        """Every form on the command line."""
        if isinstance(self.kind, Switch) and self.default is True:
            return (f"{self.flag}/--no-{self.name}",)
        alias = [f"--{self.alias}"] if self.alias else []
        return (self.flag, *alias, *([f"-{self.letter}"] if self.letter else []))

    @property
    def said(self) -> str:
        """What it is, and what is allowed."""
        between = ", " if isinstance(self.kind, Number | Counts) else ": "
        return between.join(filter(None, [self.help.rstrip("."), self.kind.allowed])) + "."

    @property
    def shown_default(self) -> str | None:
        """The default as a user types it, or in words; None if a value must be given."""
        if self.shown is not None or self.default in (..., None, ()):
            return self.shown
        return self.kind.show(self.default)

    def read(self, given: Any) -> Any:
        """The field's value; raises UsageError."""
        if self.many:
            return tuple(self.kind.read(one, self.flag) for one in given)
        return self.kind.read(given, self.flag)


def setting(
    help: str, kind: Kind, default: Any = MISSING, option: str | None = None, **more: Any
) -> Any:
    """A dataclass field that is an option; `option` is its name if that is not the field's.

    `more` are fields of `Setting`.
    """
    said = {"help": help, "kind": kind, "name": option, **more}
    return field(default=default, metadata=said)


def settings_of(spec: type) -> dict[str, Setting]:
    """The options that are declared by the fields of a dataclass, by name, in order."""
    declared = (_declared(one) for one in fields(spec) if "kind" in one.metadata)
    return {one.name: one for one in declared}


def _declared(one: Field) -> Setting:
    said = {**one.metadata, "name": one.metadata["name"] or one.name.replace("_", "-")}
    default = ... if one.default is MISSING else one.default
    return Setting(field=one.name, default=default, **said)
