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
    """The engines' answers for every field; a missing engine says how to install it."""
    answers: dict[str, dict[str, str]] = {}
    for name in registry.names("backend"):
        try:
            answers[name] = dict(registry.load("backend", name).support)
        except CommandError as error:
            answers[name] = dict.fromkeys(field_names(), f"unknown: {error}")
    table = Table("field", *answers, header_style="bold")
    for field in field_names():
        table.add_row(field, *(engine.get(field, "no answer") for engine in answers.values()))
    return answers, table
