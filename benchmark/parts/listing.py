"""`bench list`: all plug-ins by name, and the engines' support of every number of the spec."""

from rich.table import Table

from backends.effect import UNITS, Effect
from backends.spec import field_names
from backends.sticks import STICKS
from benchmark.errors import CommandError, unknown
from benchmark.parts import registry
from files.plugins import KINDS


def parts(kind: str | None = None) -> tuple[dict, Table]:
    """Every plug-in and stick with a line about it; imports no engine.

    `kind`, singular or plural, restricts the list to one kind; effects alone are listed with units
    and bounds. Raises UsageError for an unknown kind.
    """
    kinds = (*KINDS, "stick")
    if kind is not None and kind.removesuffix("s") not in kinds:
        raise unknown("kind", kind, kinds)
    kind = kind and kind.removesuffix("s")
    if kind == "effect":
        return _effects()
    found = {
        kind: {name: registry.part(kind, name).summary for name in registry.names(kind)}
        for kind in KINDS
    }
    found["stick"] = {
        s.name: f"{s.shape}, {2e3 * s.radius_m:g} mm, {1e3 * s.mass_kg:g} g, mu {s.friction:g}"
        for s in STICKS.values()
    }
    found = {name: lines for name, lines in found.items() if kind in (None, name)}
    table = Table("kind", "name", "what it is", header_style="bold")
    for kind, names in found.items():
        for name, line in names.items():
            table.add_row(kind, name, line)
    return found, table


def _effects() -> tuple[dict, Table]:
    """Every effect with its unit, its bounds in that unit, and whether it acts on joints."""
    table = Table("effect", "unit", "allowed", "joints", "what it is", header_style="bold")
    found = {}
    for name in registry.names("effect"):
        one: type[Effect] = registry.load("effect", name)
        low, high = (bound / UNITS[one.unit][1] for bound in one.bounds)
        line = registry.part("effect", name).summary
        found[name] = {"unit": one.unit, "bounds": [low, high], "per_joint": one.per_joint}
        joints = "all, or @JOINT" if one.per_joint else "-"
        table.add_row(name, one.unit, f"{low:g} to {high:g}", joints, line)
    return {"effect": found}, table


def support() -> tuple[dict, Table]:
    """The engines' support of every field and effect; a missing engine says how to install it."""
    answers = {name: _answers(name) for name in registry.names("backend")}
    asked = {field: (field,) for field in field_names()}
    for name in registry.names("effect"):
        asked[f"effect {name}"] = registry.load("effect", name).spec_fields()
    found = {
        engine: {
            what: "; ".join(dict.fromkeys(taken[f] for f in fields))
            for what, fields in asked.items()
        }
        for engine, taken in answers.items()
    }
    table = Table("field", *found, header_style="bold")
    for what in asked:
        table.add_row(what, *(engine[what] for engine in found.values()))
    return found, table


def _answers(backend: str) -> dict[str, str]:
    try:
        return dict(registry.load("backend", backend).support)
    except CommandError as error:
        return dict.fromkeys(field_names(), f"unknown: {error}")
