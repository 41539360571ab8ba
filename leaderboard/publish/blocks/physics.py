"""What every engine makes of the physics checks."""

from typing import Any

from leaderboard._grid import grid
from leaderboard.publish.kept import Kept, KeptError
from leaderboard.publish.registry import block
from leaderboard.publish.words import in_order, shown

Checks = dict[str, dict[str, dict[str, Any]]]
"""Checks by their names, and by engine."""
OWN = (
    "slip on the diagonal, threshold over mu times squeeze",
    "spin at the pinch, threshold over mu times squeeze times radius",
    "spin under 0.8 of the pull that slips, threshold over that without a pull",
    "sliding in a grip of 0.1 N, share of the time without contact",
    "sinking of the stick into the skin at 4 N",
    "held stick, moved in 1.8 s",
    "open-loop grasp, half the time step",
    "open-loop grasp, start 1 um higher",
    "open-loop grasp, start 0.1 mm higher",
    "open-loop grasp, distance of the lower end",
    "open-loop grasp, distance of the pinched point",
)
"""Checks whose figures are an engine's own."""


@block
def physics_engines(kept: Kept) -> str:
    """In what engines differ."""
    checks = _checks(kept)
    if missing := [name for name in OWN if name not in checks]:
        raise KeptError(f"leaderboard/physics.json has no check '{missing[0]}'; see {__name__}")
    rows = [[_named(checks[name]), *_figures(kept, checks[name])] for name in OWN]
    return grid(["", *_engines(kept)], rows)


@block
def physics_checks(kept: Kept) -> str:
    """Every check of every engine."""
    rows = []
    for found in _checks(kept).values():
        expected = dict.fromkeys(f"{check['expected']:.4g}" for check in found.values())
        bounds = dict.fromkeys(f"{check['bound']:.2g}" for check in found.values())
        shown = [_named(found), " or ".join(expected), " or ".join(bounds)]
        rows.append([*shown, *_figures(kept, found)])
    return grid(["check", "expected", "off by at most", *_engines(kept)], rows)


@block
def physics_said(kept: Kept) -> str:
    """How many checks passed, and on what."""
    engines = kept.physics["engines"]
    parts = [
        f"{shown(name)} passes {sum(c['passed'] for c in found['checks'])} of "
        f"{len(found['checks'])} checks"
        for name, found in ((name, engines[name]) for name in in_order(engines))
    ]
    made = kept.physics["provenance"]
    packages = [engines[name]["package"] for name in in_order(engines)]
    versions = [f"{name} {made['versions'][name]}" for name in packages]
    return (
        f"{', '.join(parts)}. Found on {made['finished'][:10]} at commit {made['commit'][:9]} with "
        f"{', '.join(versions)} on {made['cpu']}."
    )


def _engines(kept: Kept) -> list[str]:
    return [shown(name) for name in in_order(kept.physics["engines"])]


def _checks(kept: Kept) -> Checks:
    found: Checks = {}
    for engine, result in kept.physics["engines"].items():
        for check in result["checks"]:
            found.setdefault(check["name"], {})[engine] = check
    return found


def _named(found: dict[str, dict[str, Any]]) -> str:
    """A check with its unit."""
    check = next(iter(found.values()))
    return check["name"] if check["unit"] == "1" else f"{check['name']} [{check['unit']}]"


def _figures(kept: Kept, found: dict[str, dict[str, Any]]) -> list[str]:
    return [_figure(found.get(engine)) for engine in in_order(kept.physics["engines"])]


def _figure(check: dict[str, Any] | None) -> str:
    if check is None:
        return ""
    if check["figure"] is None:
        return "not finite"
    text = f"{check['figure']:.4g}" if check["expected"] else f"{check['figure']:.2g}"
    return text if check["passed"] else f"**{text}, failed**"
