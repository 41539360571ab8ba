"""Options that several commands have, declared once; defaults stand with the commands.

An option of one name means the same in every command. Settings of a run (engine, task, figure,
stick, effects, training) are declared by the fields of `RunSpec`; what is asked of a log, by those
of `benchmark.gap.asked`.
"""

from pathlib import Path
from typing import Annotated

from benchmark.settings.kinds import File, Number, Setting, Switch, Text
from leaderboard.identity import EPISODES

DIR, FILE = File("DIR"), File("FILE")
MOST_WORKERS = 10_000
"""More cores than any machine has."""
COUNT = Number(1, whole=True)

# What is written, and what is in the way.
Out = Annotated[Path | None, Setting(name="out", kind=DIR, help="Folder to write to.")]
Made = Annotated[
    Path | None,
    Setting(
        name="out",
        kind=DIR,
        help="Folder to write to; files of an earlier call are replaced.",
    ),
]
"""Where tables and pictures go that are made from runs."""
NewFolder = Annotated[Path, Setting(name="out", kind=DIR, help="Folder to write to.")]
Submission = Annotated[
    Path,
    Setting(
        name="out",
        kind=DIR,
        help="Folder to write to; an earlier submission is replaced.",
    ),
]
OutFile = Annotated[Path, Setting(name="out", kind=FILE, help="File to write.")]
Force = Annotated[bool, Setting(kind=Switch(), help="Replace what an earlier call wrote there.")]
Resume = Annotated[bool, Setting(kind=Switch(), help="Continue a killed run.")]
DryRun = Annotated[
    bool, Setting(kind=Switch(), help="Say what would be run and how long it takes.")
]
IncludeSmoke = Annotated[bool, Setting(kind=Switch(), help="Take smoke runs, too.")]

# What is given.
Run = Annotated[Path, Setting(kind=File("RUN"), help="Folder of a finished run.", argument=True)]
Runs = Annotated[
    tuple[Path, ...],
    Setting(
        kind=File("RUN"), help="Folders of finished runs, or of many.", argument=True, many=True
    ),
]
Policy = Annotated[
    Path | None,
    Setting(kind=File("RUN"), help="Finished run whose policy plays the protocol 'policy'."),
]

# Worlds.
Backends = Annotated[
    str,
    Setting(
        name="backend",
        alias="engine",
        kind=Text("NAMES", completed_by="backend"),
        help="Engines that simulate, between commas.",
    ),
]
HiddenEffects = Annotated[
    str,
    Setting(
        kind=Text("NAMES"),
        help="Effects that may be hidden, between commas; all: those of the rig.",
    ),
]
Protocol = Annotated[
    str,
    Setting(
        kind=Text("NAMES"),
        help="Excitation protocols between commas; all: every one that fits.",
    ),
]
Real = Annotated[
    str,
    Setting(
        kind=Text("NAMES"),
        help="What stands for reality: engines of `bench list backend`, or files of "
        "diagnosis/blind/engines and mechanics; between commas.",
    ),
]
Rig = Annotated[
    str,
    Setting(
        kind=Text("NAMES"),
        help="What is moved, between commas: finger, hand, joint; held: the stick in the hand; "
        "arm: drawn robots of 2, 3 and 6 joints, or arm1, arm2, arm3, arm6.",
    ),
]

# How much, how fast, how it is drawn.
Episodes = Annotated[
    int | None,
    Setting(kind=Number(1, EPISODES, whole=True), help="Episodes, the first of a fixed list."),
]
Cases = Annotated[int, Setting(kind=Number(1, 999, whole=True), help="Number of cases.")]
Seed = Annotated[
    int, Setting(kind=Number(0, 2**32 - 1, whole=True), help="Decides every random draw.")
]
Workers = Annotated[
    int | None,
    Setting(
        kind=Number(1, MOST_WORKERS, whole=True),
        letter="j",
        help="Cores to use; changes no result.",
        shown="all",
    ),
]
Format = Annotated[
    str, Setting(name="format", kind=Text("parquet|csv"), help="Form of the log's samples.")
]

# What every command takes.
SHARED = (
    Setting(
        name="json",
        kind=Switch(),
        help="Print one JSON object on standard output, everything else on standard error.",
        default=False,
    ),
    Setting(
        name="verbose",
        letter="v",
        kind=Switch(),
        help="Say more on standard error; show tracebacks.",
        default=False,
    ),
    Setting(
        name="quiet",
        letter="q",
        kind=Switch(),
        help="No progress on standard error.",
        default=False,
    ),
)
