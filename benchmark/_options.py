"""Options that several commands take, each declared once; defaults stand with the commands."""

from pathlib import Path
from typing import Annotated

import typer

Backend = Annotated[str, typer.Option(help="Physics engine: mujoco, bullet or sapien.")]
TaskName = Annotated[
    str, typer.Option(help="Figure to draw, such as line, circle, spiral or eight: bench list.")
]
Radius = Annotated[str | None, typer.Option(help="Size of the figure, such as 3cm. (2cm)")]
Speed = Annotated[float | None, typer.Option(help="Pace over the training pace, such as 1.5. (1)")]
Stick = Annotated[str | None, typer.Option(help="Stick to hold; `bench list` names them.")]
Effects = Annotated[
    str | None,
    typer.Option(help="'built', 'none', or such as backlash=1.2deg,kp-scale=-10%@J3. (built)"),
]
NominalEffects = Annotated[
    str | None,
    typer.Option(help="Effects of the nominal world, as for --effects. (those the log names)"),
]
Workers = Annotated[
    int | None, typer.Option(help="Cores to simulate on; changes no result. (all)", min=1)
]
Seed = Annotated[int, typer.Option(help="Decides every random draw of the training.")]
Out = Annotated[Path | None, typer.Option(help="Folder to write to.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what is in the folder.")]
Log = Annotated[Path, typer.Argument(metavar="LOG", help="Folder of the log.")]
Form = Annotated[str, typer.Option(help="Form of the samples: parquet or csv.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
