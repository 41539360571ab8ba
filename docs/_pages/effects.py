"""A page per group of effects, from the effects' own docstrings and numbers."""

from collections import defaultdict

from _pages._source import TEXTS, read_text
from backends.effect import Effect, description, magnitudes
from benchmark.parts import registry

FOLDER = "reference/effects"


def pages() -> dict[str, str]:
    """The index and the pages of all groups."""
    groups: dict[str, list[tuple[str, type[Effect]]]] = defaultdict(list)
    for name in registry.names("effect"):
        kind = registry.load("effect", name)
        groups[kind.group].append((name, kind))
    made = {f"{FOLDER}/{slug(group)}.md": _page(group, groups[group]) for group in groups}
    return {f"{FOLDER}/index.md": _index(dict(sorted(groups.items()))), **made}


def slug(group: str) -> str:
    """A group's file name."""
    return group.replace(" ", "-")


def _index(groups: dict[str, list[tuple[str, type[Effect]]]]) -> str:
    rows = [
        f"| [{group}]({slug(group)}.md) | "
        + ", ".join(f"[{name}]({slug(group)}.md#{name})" for name, _ in kinds)
        + " |"
        for group, kinds in groups.items()
    ]
    table = "\n".join(["| group | effects |", "|---|---|", *rows])
    menu = "\n".join(slug(group) for group in groups)
    opening = read_text("effects/index.md", effects=table)
    return f"{opening}\n```{{toctree}}\n:hidden:\n\n{menu}\n```\n"


def _page(group: str, kinds: list[tuple[str, type[Effect]]]) -> str:
    file = TEXTS / "effects" / f"{slug(group)}.md"
    opening = file.read_text() if file.exists() else f"# {group.capitalize()}\n"
    return "\n".join([opening, *(_section(name, kind) for name, kind in kinds)])


def _section(name: str, kind: type[Effect]) -> str:
    """An effect: what it is, its number and bounds, and the points of its docstring."""
    meaning, points = description(kind)
    fields = ", ".join(f"`{field}`" for field in kind.spec_fields())
    where = "of one joint or of all" if kind.per_joint else "of the whole world"
    lines = [f"- **{point}.** {text}" for point, text in points.items()]
    return (
        f"## {name}\n\n{registry.part('effect', name).summary} {meaning}\n\n"
        f"*{magnitudes(kind)}; changes {fields}, {where}.*\n\n" + "\n".join(lines) + "\n"
    )
