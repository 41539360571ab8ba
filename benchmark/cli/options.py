"""Options that several commands have, declared once; defaults stand with the commands.

An option of one name means the same in every command. Settings of a run (engine, task, figure,
stick, effects, training) are declared by the fields of `RunSpec`; what is asked of a log, by those
of `benchmark.gap.asked`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from benchmark.parts import registry
from benchmark.settings.kinds import Number, Setting


def completes(kind: str) -> Callable[[str], list[str]]:
    """Completes the name of a plug-in in a shell."""

    def names(incomplete: str) -> list[str]:
        return [name for name in registry.names(kind) if name.startswith(incomplete)]

    return names


# What is written, and what is in the way.
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder to write to.")]
Made = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="DIR", help="Folder to write to; files of an earlier call are replaced."
    ),
]
"""Where tables and pictures go that are made from runs."""
NewFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write to.")]
Submission = Annotated[
    Path,
    typer.Option(
        "--out", metavar="DIR", help="Folder to write to; an earlier submission is replaced."
    ),
]
OutFile = Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what an earlier call wrote there.")]
Resume = Annotated[bool, typer.Option("--resume", help="Continue a killed run.")]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Say what would be run and how long it takes.")
]
IncludeSmoke = Annotated[bool, typer.Option("--include-smoke", help="Take smoke runs, too.")]

# What is given.
Run = Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")]
Runs = Annotated[
    list[Path], typer.Argument(metavar="RUN", help="Folders of finished runs, or of many.")
]
Policy = Annotated[
    Path | None,
    typer.Option(metavar="RUN", help="Finished run whose policy plays the protocol 'policy'."),
]

# Worlds.
Backends = Annotated[
    str,
    typer.Option(
        "--backend",
        "--engine",
        metavar="NAMES",
        help="Engines that simulate, between commas.",
        autocompletion=completes("backend"),
    ),
]
HiddenEffects = Annotated[
    str,
    typer.Option(
        metavar="NAMES", help="Effects that may be hidden, between commas; all: those of the rig."
    ),
]
Protocol = Annotated[
    str,
    typer.Option(
        metavar="NAMES", help="Excitation protocols between commas; all: every one that fits."
    ),
]
Real = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="What stands for reality: engines of `bench list backend`, or files of "
        "diagnosis/blind/engines and mechanics; between commas.",
    ),
]
Rig = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="What is moved: some of finger,hand,joint; held, with the stick; or arm, drawn "
        "robots of 2, 3 and 6 joints (arm1, arm2, arm3, arm6 alone).",
    ),
]

# How much, how fast, how it is drawn.
Episodes = Annotated[
    int | None,
    typer.Option(metavar="N", help="Episodes, the first of a fixed list."),
]
Cases = Annotated[int, Setting(help="Number of cases.", kind=Number(1, 999, whole=True))]
Rate = Annotated[float, Setting(help="Samples a second.", kind=Number(1, 1000, "Hz"))]
Seed = Annotated[
    int, Setting(help="Decides every random draw.", kind=Number(0, 2**32 - 1, whole=True))
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        "-j",
        metavar="N",
        min=1,
        help="Cores to use; changes no result.",
        show_default="all",
    ),
]
Format = Annotated[
    str, typer.Option("--format", metavar="parquet|csv", help="Form of the log's samples.")
]

# What every command takes.
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print one JSON object on standard output, everything else on standard error.",
    ),
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say more on standard error; show tracebacks.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress on standard error.")]
