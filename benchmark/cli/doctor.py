"""`bench doctor`: what is installed, and `bench doctor physics`: how good it is."""

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from benchmark.cli.command import command
from benchmark.cli.options import FILE, Backends
from benchmark.errors import UsageError
from benchmark.settings.kinds import Setting


class FirstUnlessNamed(TyperGroup):
    """Commands, the first of which runs where none is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Name the first command where it is meant; refuse an option that is a command."""
        for word in args:
            if word.startswith("--") and word[2:] in self.commands:
                raise UsageError(f"No such option: {word}; run `{ctx.command_path} {word[2:]}`.")
        asks_help = bool(args) and args[0] in ctx.help_option_names
        unnamed = not args or args[0].startswith("-")
        if unnamed and not asks_help and not ctx.resilient_parsing:
            args = [next(iter(self.commands)), *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=FirstUnlessNamed,
    help="Check the installation; [bold]bench doctor physics[/bold] checks the engines.",
    rich_markup_mode="rich",
)


@app.command()
@command()
def installation() -> Any:
    """Check every engine and learner: version, whether it works, and how to fix it.

    This is what [bold]bench doctor[/bold] alone does.

    Example: [bold]bench doctor[/bold]
    """
    from benchmark.parts.doctor import examine

    return examine()


@app.command()
@command(defaults={"backend": "all", "out": "none"})
def physics(
    backend: Backends = "all",
    out: Annotated[
        Path | None,
        Setting(kind=FILE, help="Markdown file for the tables, with the reason of every bound."),
    ] = None,
) -> Any:
    """Compare engines with closed forms and with the reference engine, in about a minute.

    Example: [bold]bench doctor physics --backend bullet[/bold]
    """
    from benchmark.parts.doctor import examine_physics

    return examine_physics(backend, out)
