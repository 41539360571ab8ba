"""`bench diagnose LOG --healthy NORMAL` of a log that names no model: what differs, by group."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from benchmark.provenance import provenance
from diagnosis.compare import LOCAL, NONE, Compared, Difference, compare
from diagnosis.logs._columns import SHOWN
from diagnosis.logs.log import Log
from files.atomic import write_atomically

FILE, PICTURE = "diagnosis.json", "differences.png"
MOST_JOINTS = 16


def run(
    log: Log, path: Path, healthy: Sequence[Path], sound: Sequence[Log], folder: Path
) -> tuple[dict, RenderableType]:
    """Compare, and write diagnosis.json and a picture; returns the result and its summary.

    `sound`: the logs at `healthy`. Raises LogError where the logs cannot be compared.
    """
    found = compare(log, sound)
    folder.mkdir(parents=True, exist_ok=True)
    _draw(log, sound, found, folder / PICTURE)
    named = [one for one in found if one.group != NONE and not one.pulled]
    lines = [_sentence(one, log, len(sound)) for one in named or found[:1]]
    lines += [
        f"{one.joint} differs far less, as if {named[0].joint} pulled it."
        for one in found
        if one.pulled
    ]
    result = {
        "status": "done",
        "dir": str(folder),
        "written": [str(folder / FILE), str(folder / PICTURE)],
        "log": str(path),
        "healthy": list(map(str, healthy)),
        "verdict": list(dict.fromkeys(one.group for one in named)) or [NONE],
        "joints": [one.joint for one in named],
        "sentence": " ".join(lines),
        "groups": [asdict(one) for one in found],
    }
    whole = result | {"provenance": provenance()}
    write_atomically(folder / FILE, json.dumps(whole, indent=1, allow_nan=False) + "\n")
    return result, Group(
        *map(Text, lines), _table(found), Text(f"Wrote {folder / FILE} and {folder / PICTURE}.")
    )


def _sentence(one: Compared, log: Log, count: int) -> str:
    """What is said of a joint."""
    if one.group == NONE:
        return f"none: of no joint is anything beyond what {count} healthy logs show."
    most = ", ".join(
        f"{d.name} {d.score:+.1f}" for d in sorted(_beyond(one), key=lambda d: -abs(d.score))[:3]
    )
    place = ""
    if one.group == LOCAL and one.place is not None:
        size, unit, _ = SHOWN[log.is_linear(one.joint)]
        place = f", most at {size * one.place:.1f} {unit}"
    return (
        f"{one.group} at {one.joint}{place}: it differs from {count} healthy logs with "
        f"{100 * one.confidence:.1f} % ({most}, in standard deviations of theirs)."
    )


def _beyond(one: Compared) -> Iterator[Difference]:
    return (difference for difference in one.differences if difference.beyond)


def _table(found: Sequence[Compared]) -> Table:
    table = Table(
        "joint", "group", "differs", *(d.name for d in found[0].differences), header_style="bold"
    )
    for one in found:
        scores = (f"{'* ' if d.beyond else ''}{d.score:+.1f}" for d in one.differences)
        differs = "-" if one.group == NONE else f"{100 * one.confidence:.0f} %"
        table.add_row(one.joint, one.group, differs, *scores)
    return table


def _draw(log: Log, healthy: Sequence[Log], found: Sequence[Compared], file: Path) -> None:
    """Per joint, how today's log and healthy ones lie beside the healthy mean, first episode."""
    joints = [one.joint for one in sorted(found, key=lambda one: -one.oddest)][:MOST_JOINTS]
    kinds = ["position", *(["torque"] if all(log.has("torque", j) for j in joints) else [])]
    figure = Figure(figsize=(11, 1.0 + 2.0 * len(joints)), layout="constrained")
    axes = figure.subplots(len(joints), len(kinds), squeeze=False, sharex=True)
    number = log.episodes[0].episode
    for row, joint in zip(axes, joints, strict=True):
        for axis, kind in zip(row, kinds, strict=True):
            today = log.signal(kind, number, [joint])[:, 0]
            sound = [h.signal(kind, h.episodes[0].episode, [joint])[:, 0] for h in healthy]
            n = min(map(len, [today, *sound]))
            usual, time_s = np.mean([s[:n] for s in sound], axis=0), log.episode(number)["t_s"][:n]
            for one in sound:
                axis.plot(time_s, one[:n] - usual, color="lightgray", lw=0.8)
            axis.plot(time_s, today[:n] - usual, color="tab:red", lw=1.0)
            unit = log.column(kind, joint).split("_", 1)[1].split(".")[0]
            axis.set_title(f"{joint}: {kind} [{unit}], minus its healthy mean", fontsize="small")
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.savefig(file, dpi=110)
