"""The page on what a user may import, from signatures and docstrings."""

import inspect
from math import inf
from typing import Any

from _pages._source import doc, fields, read_text, signature, table, to_table


def pages() -> dict[str, str]:
    """The page."""
    text = read_text("python.md", **_environments(), **_worlds())
    return {"reference/python.md": text}


def _environments() -> dict[str, str]:
    from tasks.batch import BatchEnv, Step

    return {
        "face": _face(),
        "settings": _settings(),
        "batch": f"{doc(BatchEnv)}\n\n{_members(BatchEnv)}",
        "step": f"{doc(Step)}\n\n{table(Step)}",
    }


def _settings() -> str:
    """Fields of a run's spec: what they mean, and their defaults as they are typed."""
    from benchmark.settings.run_spec import SETTINGS, RunSpec

    declared = {name: one for one in SETTINGS.values() for name in (one.field, one.alias)}
    lines = []
    for name, _, said in fields(RunSpec):
        if one := declared.get(name):
            name, said = one.field, one.said
        lines.append((name, (one and one.shown_default) or "", said))
    return to_table(lines, "default")


def _worlds() -> dict[str, str]:
    from backends.spec import Spec

    return {"spec": f"{doc(Spec)}\n\n{table(Spec)}\n{_members(Spec)}"}


def _face() -> str:
    """Everything that `stickbench` exports."""
    import stickbench

    parts = []
    for name in stickbench.__all__:
        thing = getattr(stickbench, name)
        if inspect.isclass(thing):
            parts += [f"### {name}\n\n{doc(thing)}\n", _members(thing)]
        else:
            parts.append(_entry(f"sb.{name}", thing))
    return "\n".join(parts)


def _members(kind: type) -> str:
    """The class's own public methods and properties, as a definition list."""
    shown = []
    for name, member in vars(kind).items():
        if name.startswith("_"):
            continue
        if inspect.isfunction(member):
            shown.append(_item(signature(name, member, inf), member))
        elif isinstance(member, property):
            shown.append(_item(name, member))
        elif hasattr(member, "func"):
            shown.append(_item(name, member.func))
    return "\n".join(shown)


def _entry(name: str, call: Any) -> str:
    """A function with its signature."""
    title = name.rpartition(".")[2]
    return f"### {title}\n\n```python\n{signature(name, call)}\n```\n\n{doc(call)}\n"


def _item(shown: str, thing: Any) -> str:
    """An item of a definition list."""
    text = doc(thing).replace("\n", "\n  ")
    return f"`{shown}`\n: {text}\n"
