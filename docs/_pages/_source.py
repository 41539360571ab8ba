"""What classes and functions say of themselves in their source."""

import ast
import dataclasses
import inspect
import re
from pathlib import Path
from typing import Any

TEXTS = Path(__file__).resolve().parent.parent / "_texts"
"""What is written by hand and made pages begin with."""


def fields(kind: type) -> list[tuple[str, str, str]]:
    """Name, type and text of every field that the class itself declares, in order."""
    tree = ast.parse(inspect.cleandoc(f"\n{inspect.getsource(kind)}")).body[0]
    assert isinstance(tree, ast.ClassDef)
    found = []
    for item, after in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            typed = ast.unparse(item.annotation)
            if not item.target.id.startswith("_") and "ClassVar" not in typed:
                found.append((_alias(item), _type(typed), _string(after)))
    return found


def rows(kind: type) -> list[tuple[str, str, str]]:
    """The `fields` that are shown: those of a dataclass that its `repr` shows, too."""
    hidden = {f.name for f in dataclasses.fields(kind) if not f.repr} if _is_data(kind) else set()
    return [row for row in fields(kind) if row[0] not in hidden]


def table(kind: type, **texts: str) -> str:
    """The fields as a table; `texts` say what the source does not."""
    return to_table(
        [(name, typed, said or texts.get(name, "")) for name, typed, said in rows(kind)]
    )


def to_table(lines: list[tuple[str, str, str]], second: str = "type") -> str:
    """Names, types and meanings as Markdown."""
    made = [f"| `{name}` | {typed.replace('|', 'or')} | {said} |" for name, typed, said in lines]
    return "\n".join([f"| field | {second} | meaning |", "|---|---|---|", *made]) + "\n"


def read_text(name: str, **parts: str) -> str:
    """What was written by hand in `docs/_texts`, with what is made in the place of `<<part>>`."""
    text = (TEXTS / name).read_text()
    for part, made in parts.items():
        if f"<<{part}>>" not in text:
            raise LookupError(f"docs/_texts/{name} has no <<{part}>>")
        text = text.replace(f"<<{part}>>", made)
    return text


def doc(thing: Any) -> str:
    """The docstring, cleaned."""
    return inspect.cleandoc(thing.__doc__ or "")


def signature(name: str, call: Any, width: float = 80) -> str:
    """How it is called, one argument a line where it is long."""
    said = inspect.signature(call)
    kept = [p for p in said.parameters.values() if p.name not in ("self", "cls")]
    shown = f"{name}{_bare(said.replace(parameters=kept))}"
    if len(shown) <= width:
        return shown
    inner = "".join(f"    {_bare(parameter)},\n" for parameter in kept)
    _, _, gives = shown.rpartition(" -> ")
    return f"{name}(\n{inner}) -> {gives}"


def _is_data(kind: type) -> bool:
    return dataclasses.is_dataclass(kind)


def _bare(part: Any) -> str:
    """Source without the modules of its types, and without quotes about them."""
    text = re.sub(r"\b(?:\w+\.)+(?=[A-Za-z])", "", str(part)).replace("ndarray", "Array")
    text = re.sub(r"<class '(\w+)'>", r"\1", text)
    return re.sub(r"(: |-> )'([^']*)'", r"\1\2", text)


def _string(item: ast.stmt | None) -> str:
    if isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant):
        return " ".join(str(item.value.value).split())
    return ""


def _alias(item: ast.AnnAssign) -> str:
    """The name in the file: pydantic's alias where there is one."""
    for part in ast.walk(item):
        if isinstance(part, ast.keyword) and part.arg == "alias":
            return str(ast.literal_eval(part.value))
    return item.target.id if isinstance(item.target, ast.Name) else ""


_PLAIN = {
    "Fraction": "0 to 1",
    "Positive": "number > 0",
    "NotNegative": "number >= 0",
    "Count": "whole number",
    "Name": "text",
    "Array": "array",
    "float": "number",
    "int": "whole number",
    "str": "text",
    "bool": "true or false",
    "dict": "object",
    "None": "null",
}


def _type(text: str) -> str:
    """A type in plain words, such as 'list of text' for tuple[str, ...]."""
    text = re.sub(r"Annotated\[(\w+), Field\(ge=0, le=(\d+)\)\]", r"0 to \2", text)
    text = re.sub(r"Annotated\[int, Field\(ge=(\d+)\)\]", r"whole number from \1", text)
    text = re.sub(r"Literal\[(.*)\]", lambda m: m[1].replace("'", "").replace(", ", " | "), text)
    text = re.sub(r"\b(?:list|tuple|Sequence)\[([\w. |]+?)(?:, \.\.\.)?\]", r"list of \1", text)
    text = re.sub(r"tuple\[(float|int|str), (float|int|str)\]", "pair", text)
    text = re.sub(r"\b(?:list|tuple)\[(tuple\[.*\]|pair), \.\.\.\]", "list of pairs", text)
    text = re.sub(r"\b(?:dict|Mapping)\[str, ([\w. |]+)\]", r"\1 by name", text)
    return re.sub(r"\b[A-Za-z]+\b", lambda m: _PLAIN.get(m[0], m[0]), text).replace(" | ", " or ")
