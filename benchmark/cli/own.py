"""`bench new` and `bench test`: parts of one's own."""

from pathlib import Path
from typing import Annotated, Any

import typer

from benchmark.cli.command import command
from benchmark.parts.new_part import SUITES

KINDS = " or ".join(SUITES)


@command(defaults={"out": "here", "package": "the folder's name"})
def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help=f"{KINDS}.")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Its name, such as long-lever.")],
    package: Annotated[
        str | None, typer.Option(metavar="PACKAGE", help="Package that it stands in.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder of the project.")
    ] = None,
) -> Any:
    """Write a part that works, its test and its entry point, to be changed into your own.

    Example: [bold]bench new task clover[/bold]
    """
    from benchmark.parts import new_part

    return new_part.new(kind, name, out or Path(), package)


@command()
def test(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"Name of a {KINDS}.")],
) -> Any:
    """Check that a part keeps the contract of its kind; exit with 1 where it does not.

    Example: [bold]bench test circle[/bold]
    """
    from benchmark.parts import new_part

    return new_part.check(name)
