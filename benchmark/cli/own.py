"""`bench new` and `bench test`: parts of one's own."""

from pathlib import Path
from typing import Annotated, Any

from benchmark.cli.command import command
from benchmark.cli.options import DIR
from benchmark.parts.new_part import SUITES
from benchmark.settings.kinds import Choice, Setting, Text

KINDS = " or ".join(SUITES)


@command(defaults={"out": "here", "package": "the folder's name"})
def new(
    kind: Annotated[
        str, Setting(kind=Choice("kind", tuple(SUITES), "KIND"), help="Its kind.", argument=True)
    ],
    name: Annotated[
        str, Setting(kind=Text("NAME"), help="Its name, such as long-lever.", argument=True)
    ],
    package: Annotated[
        str | None, Setting(kind=Text("PACKAGE"), help="Package that it stands in.")
    ] = None,
    out: Annotated[Path, Setting(kind=DIR, help="Folder of the project.")] = Path(),
) -> Any:
    """Write a part that works, its test and its entry point, to be changed into your own.

    Example: [bold]bench new task clover[/bold]
    """
    from benchmark.parts import new_part

    return new_part.new(kind, name, out, package)


@command()
def test(
    name: Annotated[str, Setting(kind=Text("NAME"), help=f"Name of a {KINDS}.", argument=True)],
) -> Any:
    """Check that a part keeps the contract of its kind; exit with 1 where it does not.

    Example: [bold]bench test circle[/bold]
    """
    from benchmark.parts import new_part

    return new_part.check(name)
