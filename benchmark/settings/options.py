"""Options that belong together: the fields of a dataclass, which a command takes as one argument.

Each option is declared once, as a field: its type, default and help, and what the help calls it.
"""

from dataclasses import field
from typing import Any

NO_DEFAULT = ""
"""Nothing is said of a default."""


def option(
    help: str,
    metavar: str = "",
    default: Any = None,
    name: str | None = None,
    shown: str = NO_DEFAULT,
    argument: bool = False,
) -> Any:
    """A field that is an option; `name` is its name if that is not the field's.

    `shown` says its default in words. An `argument` is given without a name.
    """
    said = {
        "help": help,
        "metavar": metavar or None,
        "option": name,
        "shown": shown,
        "argument": argument,
    }
    return field(default=default, metadata=said)
