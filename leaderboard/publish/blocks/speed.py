"""Steps per second beside the bare engines'."""

from typing import Any

from leaderboard._grid import grid
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import in_order, percent, shown


@block
def speed(kept: Kept) -> str:
    """Every batch on one core and on two."""
    head = (
        *("engine", "worlds", "steps/s, 1 core", "bare physics steps/s", "overhead"),
        *("steps/s, 2 cores", "gain", "overhead on 2"),
    )
    rows = kept.speed["rows"]
    engines = in_order({row["backend"] for row in rows})
    few = [r for e in engines for r in rows if r["backend"] == e and r["processes"] == 1]
    return grid(head, [_row(row, _on_two(row, rows)) for row in few])


@block
def speed_best(kept: Kept) -> str:
    """The best batch of every engine in words, and on what it was measured."""
    best = kept.speed["engines"]
    parts = [
        f"{shown(name)} is fastest with {row['envs']} worlds: everything around the engine costs "
        f"{percent(row['overhead'])} there, and one more world takes "
        f"{row['memory_mb_per_world']:.2g} MB"
        for name, row in ((name, best[name]) for name in in_order(best))
    ]
    gains = [row["gain"] for name in best if (row := _on_two(best[name], kept.speed["rows"]))]
    machine = kept.speed["machine"]
    return (
        f"{'. '.join(parts)}. Two cores give {min(gains):.2f} to {max(gains):.2f} times as much as "
        f"one. Measured on {machine['cores']} cores of {machine['cpu']} with a load of "
        f"{machine['load_before']:g} before, on {machine['finished'][:10]} at commit "
        f"{machine['commit'][:9]}."
    )


def _row(few: dict[str, Any], two: dict[str, Any] | None) -> list[str]:
    cells = [
        shown(few["backend"]),
        str(few["envs"]),
        f"{few['env_steps_per_s']:,.0f}",
        f"{few['raw_physics_steps_per_s']:,.0f}",
        _overhead(few),
    ]
    if two is None:
        return [*cells, "", "", ""]
    return [
        *cells,
        f"{two['env_steps_per_s']:,.0f}",
        f"{two['gain']:.2f}",
        _overhead(two),
    ]


def _overhead(row: dict[str, Any]) -> str:
    """The median and its quartiles."""
    low, high = (f"{100 * x:.1f}" for x in row["overhead_quartiles"])
    return f"{percent(row['overhead'])} ({low} to {high})"


def _on_two(few: dict[str, Any], rows: list[dict[str, Any]]) -> dict[str, Any] | None:
    """As many worlds on two cores, if they were measured."""
    same = (r for r in rows if all(r[k] == few[k] for k in ("backend", "envs")))
    return next((row for row in same if row["processes"] == 2), None)
