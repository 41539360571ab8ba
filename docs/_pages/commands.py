"""A page per command of `bench`, from the program itself: what its `--help` says, no more."""

import re
from collections.abc import Iterator
from typing import Any

from rich.text import Text
from typer.main import get_command

from _pages._source import read_text
from benchmark.cli.app import app

FOLDER = "reference/commands"


def pages() -> dict[str, str]:
    """The index and a page per command, as `bench --help` has them."""
    found = list(_commands(get_command(app), ()))
    made = {f"{FOLDER}/{'-'.join(words)}.md": _page(words, one) for words, one, _ in found}
    return {f"{FOLDER}/index.md": _index(found), **made}


def _commands(group: Any, words: tuple[str, ...], panel: str = "") -> Iterator[tuple]:
    """Words, command and panel of every command that does something, in the order of the help."""
    for name, one in group.commands.items():
        panel_of = panel or one.rich_help_panel or "Commands"
        if hasattr(one, "commands"):
            yield from _commands(one, (*words, name), panel_of)
        elif not one.hidden:
            yield (*words, name), one, panel_of


def _index(found: list[tuple]) -> str:
    tables = []
    for panel in dict.fromkeys(panel for *_, panel in found):
        rows = [
            f"| [bench {' '.join(words)}]({'-'.join(words)}.md) | {_prose(one.help)[0]} |"
            for words, one, of in found
            if of == panel
        ]
        tables.append(
            "\n".join([f"## {panel}\n", "| command | what it does |", "|---|---|", *rows])
        )
    menu = "\n".join(f"{' '.join(w)} <{'-'.join(w)}>" for w, *_ in found)
    text = read_text("commands.md", tables="\n\n".join(tables))
    return f"{text}\n```{{toctree}}\n:hidden:\n\n{menu}\n```\n"


def _page(words: tuple[str, ...], command: Any) -> str:
    """What a command does, how it is called, and its arguments and options."""
    name = f"bench {' '.join(words)}"
    shown = [p for p in command.params if not getattr(p, "hidden", False)]
    arguments = [p for p in shown if p.param_type_name == "argument"]
    options = [p for p in shown if p.param_type_name == "option"]
    usage = " ".join([name, "[OPTIONS]", *(_argument(p) for p in arguments)])
    what, *more = _prose(command.help)
    parts = [f"# {name}\n", f"{what}\n", f"    {usage}\n", *(f"{text}\n" for text in more)]
    if arguments:
        parts += ["## Arguments\n", *(_entry(p, _argument(p)) for p in arguments)]
    for panel in dict.fromkeys(p.rich_help_panel for p in options):
        own = [p for p in options if p.rich_help_panel == panel]
        own.sort(key=lambda p: not p.required)
        parts += [f"## {panel or 'Options'}\n", *(_entry(p, _option(p)) for p in own)]
    return "\n".join(parts)


def _prose(text: str | None) -> list[str]:
    """Paragraphs of a help text as Markdown; a command after a colon becomes code."""
    paragraphs = []
    for paragraph in re.split(r"\n\s*\n", text or ""):
        plain = Text.from_markup(" ".join(paragraph.split())).plain
        words, _, command = plain.partition(": bench ")
        if command:
            words = "For example" if words == "Example" else words
            paragraphs.append(f"{_safe(words)}:\n\n    bench {command}")
        elif plain:
            paragraphs.append(_safe(plain))
    return paragraphs


def _safe(text: str) -> str:
    """Plain text as Markdown that shows it as it is, code between backticks aside."""
    return re.sub(r"[*_<>|\[\]](?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\\\g<0>", text)


def _argument(param: Any) -> str:
    name = param.metavar or param.name.upper()
    name = name if param.nargs == 1 or name.endswith("...") else f"{name}..."
    return name if param.required else f"[{name}]"


def _option(param: Any) -> str:
    """An option as it is typed, such as '-j, --workers N'."""
    names = ", ".join(sorted(param.opts, key=len))
    if param.secondary_opts:
        names += " / " + ", ".join(param.secondary_opts)
    return names if param.is_flag or param.count else f"{names} {param.metavar}"


def _entry(param: Any, term: str) -> str:
    """An item of a definition list."""
    plain = Text.from_markup(param.help or "").plain
    text = _safe(plain).replace("(required)", "**Required.**")
    text = re.sub(r"\\\[default: (.*)\\\]$", r"*Default: \1.*", text)
    again = getattr(param, "multiple", False) and "repeatable" not in plain
    default = "" if "*Default:" in text else _default(param)
    said = [text, default, "May be given several times." if again else ""]
    return f"`{term}`\n: {' '.join(' '.join(said).split())}\n"


def _default(param: Any) -> str:
    """What holds where the option is not given."""
    shown = getattr(param, "show_default", False)
    if param.required:
        return "**Required.**"
    if isinstance(shown, str):
        return f"*Default: {_safe(shown)}.*"
    if param.param_type_name == "option" and param.secondary_opts:
        return f"*Default: {(param.opts if param.default else param.secondary_opts)[0]}.*"
    default = param.default
    nothing = default is None or default is False or default in ("", ())
    if not shown or callable(default) or nothing:
        return ""
    return f"*Default: {_safe(str(default))}.*"
