"""`bench demo`: a first look."""

from pathlib import Path
from typing import Any

from benchmark.cli.command import command
from benchmark.cli.options import Force, Out


@command(defaults={"out": "demo"})
def demo(out: Out = None, force: Force = False) -> Any:
    """Show in a minute, without training: a policy in every engine, a film, a diagnosis.

    Example: [bold]bench demo[/bold]
    """
    from benchmark.demo import demo as demos

    return demos.demo(out or Path("demo"), force)
