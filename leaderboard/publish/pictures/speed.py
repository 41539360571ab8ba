"""Time of a step over the number of worlds, beside the bare engine's."""

from collections.abc import Sequence
from math import ceil, floor, log10
from typing import Any

from leaderboard._chart import Panel, Series, Ticks, chart, colors
from leaderboard.publish.kept import Kept
from leaderboard.publish.pictures.copies import IMAGES
from leaderboard.publish.registry import picture
from leaderboard.publish.words import in_order, shown

SUBSTEPS = 20
"""Physics steps in an environment step."""


@picture(f"{IMAGES}/speed.svg")
def speed(kept: Kept) -> bytes:
    """Each engine on one core, its bare steps dashed."""
    rows = [row for row in kept.speed["rows"] if row["processes"] == 1]
    engines = in_order({row["backend"] for row in rows})
    hues = colors(engines)
    series: list[Series] = []
    for engine in engines:
        own = [row for row in rows if row["backend"] == engine]
        whole = [1e6 / row["env_steps_per_s"] for row in own]
        bare = [1e6 * SUBSTEPS / row["raw_physics_steps_per_s"] for row in own]
        series.append(_series(shown(engine), hues[engine], own, whole, dashed=False))
        series.append(_series(f"{shown(engine)} alone", hues[engine], own, bare, dashed=True))
    times = [value for one in series for value in one.y]
    worlds = sorted({row["envs"] for row in rows})
    panel = Panel(
        title="time per environment step, one core",
        x=Ticks(
            label="worlds",
            ends=(log10(worlds[0]), log10(worlds[-1])),
            at=[(log10(n), str(n)) for n in worlds],
        ),
        y=_decades(min(times), max(times)),
        series=series,
    )
    return chart([panel], 1, "Time per environment step over the number of worlds")


def _series(
    label: str, color: str, rows: Sequence[dict[str, Any]], times: list[float], dashed: bool
) -> Series:
    x = [log10(row["envs"]) for row in rows]
    return Series(label=label, color=color, x=x, y=[log10(us) for us in times], dashed=dashed)


def _decades(low: float, high: float) -> Ticks:
    """A logarithmic axis with ticks at 1, 2 and 5 of each decade."""
    values = [n * 10**e for e in range(floor(low), ceil(high) + 1) for n in (1, 2, 5)]
    inside = [log10(value) for value in values]
    first = max(v for v in inside if v <= low)
    last = min(v for v in inside if v >= high)
    shown = [v for v in inside if first <= v <= last]
    return Ticks(label="us", ends=(first, last), at=[(v, f"{10**v:.0f}") for v in shown])
