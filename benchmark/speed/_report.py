"""The output of `bench speed`: files, a picture and a table."""

import csv
import json
from pathlib import Path

from rich.table import Table

from benchmark.runs import run_folder

_COLUMNS = {
    "worlds": "{envs}",
    "cores": "{processes}",
    "env steps/s": "{env_steps_per_s:,.0f}",
    "physics steps/s": "{physics_steps_per_s:,.0f}",
    "bare engine's": "{raw_physics_steps_per_s:,.0f}",
    "overhead": "{overhead:.1%}",
    "its quartiles": "{overhead_quartiles[0]:.1%} to {overhead_quartiles[1]:.1%}",
    "over fewest cores": "x {gain:.2f}",
    "MB": "{memory_mb:,.0f}",
}
"""The columns of the table."""


def write(result: dict, rows: list[dict], out: Path) -> None:
    """Write speed.json (the result), speed.csv (its rows) and speed.png (a picture)."""
    out.mkdir(parents=True, exist_ok=True)
    run_folder.write_atomically(out / "speed.json", json.dumps(result, indent=2) + "\n")
    flat = [{k: v for k, v in row.items() if not isinstance(v, dict | list)} for row in rows]
    with (out / "speed.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(flat[0]))
        writer.writeheader()
        writer.writerows(flat)
    _plot(rows, out / "speed.png")


def _plot(rows: list[dict], path: Path) -> None:
    """Plot the time per environment step over the number of worlds; dashed: the bare engine."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, ScalarFormatter

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel="worlds")
    axes.set_ylabel("time per environment step [us]")
    for backend, cores in dict.fromkeys((row["backend"], row["processes"]) for row in rows):
        own = [row for row in rows if (row["backend"], row["processes"]) == (backend, cores)]
        worlds = [row["envs"] for row in own]
        whole = [1e6 / row["env_steps_per_s"] for row in own]
        raw = [row["us_per_env_step"]["engine"] for row in own]
        (line,) = axes.plot(worlds, whole, "o-", label=f"{backend}, {cores}")
        axes.plot(worlds, raw, "--", color=line.get_color())
    seen = sorted({row["envs"] for row in rows})
    axes.set_xticks(seen, map(str, seen))
    axes.minorticks_off()
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.grid(alpha=0.25)
    title = "engine, cores\n(dashed: the engine alone)"
    figure.legend(title=title, fontsize="small", loc="outside right upper")
    figure.savefig(path, dpi=150)


def table(result: dict) -> Table:
    """The rows, a block per engine, then a line per engine and per skipped cell."""
    shown = Table(header_style="bold")
    for column in ("engine", *_COLUMNS):
        shown.add_column(column, overflow="fold", justify="left" if column == "engine" else "right")
    for engine in result["engines"]:
        for row in (row for row in result["rows"] if row["backend"] == engine):
            shown.add_row(engine, *(text.format(**row) for text in _COLUMNS.values()))
        shown.add_section()
    notes = [_note(engine) for engine in result["engines"].values()]
    notes.append(f"the machine's load was {result['machine']['load_before']:g} before")
    notes += [f"{cell['cell']}: skipped, {cell['reason']}" for cell in result["skipped"]]
    shown.caption = "\n".join(notes)
    return shown


def _note(engine: dict) -> str:
    parts = [f"best at {engine['envs']} worlds, {engine['overhead']:.1%} over the bare engine"]
    gain = engine["gain_of_processes"].items()
    parts += [f"{n} cores give {g:.2f} times as much there" for n, g in gain]
    if (slope_mb := engine["memory_mb_per_world"]) is not None:
        parts.append(f"{slope_mb:.2f} MB per world")
    return f"{engine['backend']}: {'; '.join(parts)}"
