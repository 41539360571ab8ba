"""`bench list`: the parts by name, and what each engine makes of every number of the spec."""

from rich.table import Table

from backends.spec import field_names
from backends.sticks import STICKS
from benchmark import registry
from benchmark.errors import CommandError


def parts() -> tuple[dict, Table]:
    """Every plug-in and stick with a line about it; imports no engine."""
    found = {
        kind: {name: registry.summary(kind, name) for name in registry.names(kind)}
        for kind in registry.KINDS
    }
    found["stick"] = {
        s.name: f"{s.shape}, {2e3 * s.radius_m:g} mm, {1e3 * s.mass_kg:g} g, mu {s.friction:g}"
        for s in STICKS.values()
    }
    table = Table("kind", "name", "what it is", header_style="bold")
    for kind, names in found.items():
        for name, line in names.items():
            table.add_row(kind, name, line)
    return found, table


def support() -> tuple[dict, Table]:
    """The engines' answers for every field and effect; a missing engine says how to install it."""
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
