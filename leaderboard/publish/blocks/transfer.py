"""Policies deployed in other worlds."""

from leaderboard._grid import grid
from leaderboard.publish.kept import Kept
from leaderboard.publish.registry import block
from leaderboard.publish.words import in_order, listed, shown, world
from leaderboard.transfer_text import FLOOR, Panel, agreement_cells, interval, panels

ENGINES, VERSIONS, REFERENCE = "circle-engines", "circle-versions", "mujoco built"


@block
def transfer(kept: Kept) -> str:
    """What each train world's policies reach on the reference and keep elsewhere."""
    head = (
        *("trained in", "there", "on the reference", "kept on the reference"),
        *("kept elsewhere, mean", "least kept", "least held", "noise floor"),
    )
    panel = _panel(kept)
    order = sorted(panel.train, key=lambda name: -panel.lines[name, REFERENCE]["retention"])
    return grid(head, [_row(panel, name) for name in order])


@block
def transfer_said(kept: Kept) -> str:
    """Whose policies keep most and least, and where backlash in training helps."""
    panel = _panel(kept)
    kept_elsewhere = {name: _mean_kept(panel, name) for name in panel.train}
    best = max(kept_elsewhere, key=lambda name: kept_elsewhere[name])
    worst = min(kept_elsewhere, key=lambda name: kept_elsewhere[name])
    reached = {name: panel.lines[name, REFERENCE]["tracked"] for name in panel.train}
    engines = in_order({name.split(" ")[0] for name in panel.train})
    helped = [shown(e) for e in engines if reached[f"{e} built"] > reached[f"{e} none"]]
    return (
        f"The policies that keep most elsewhere were trained in {world(best)}, those that keep "
        f"least in {world(worst)}. A policy does better on the reference when it was trained with "
        f"the gears' backlash in {listed(helped)}."
    )


@block
def agreement(kept: Kept) -> str:
    """How well scores in another world predict those on the reference."""
    head, rows = agreement_cells(kept.agreement(ENGINES))
    shown = [[name if name == FLOOR else world(name), *cells] for _, name, *cells, _ in rows]
    return grid(head[1:-1], shown)


@block
def versions(kept: Kept) -> str:
    """What the same policies reach in other versions of the reference's engine."""
    (panel,) = panels(kept.matrix(VERSIONS))
    head = ("MuJoCo", "tracked", "kept", "held", "p_err [cm]", "q_err [deg]", "noise floor")
    rows = []
    for name in panel.deploy:
        line = panel.lines[REFERENCE, name]
        scores = (interval(line, "tracked", 2), interval(line, "retention", 2))
        errors = (f"{line['held']:.2f}", f"{line['p_err_cm']:.3f}", f"{line['q_err_deg']:.2f}")
        version = name.split(" ")[0].partition("@")[2] or "as installed"
        rows.append([version, *scores, *errors, interval(line, "floor", 2)])
    return grid(head, rows)


def _panel(kept: Kept) -> Panel:
    (panel,) = panels(kept.matrix(ENGINES))
    return panel


def _row(panel: Panel, name: str) -> list[str]:
    away = [panel.lines[name, other] for other in panel.deploy if other != name]
    home, reference = panel.lines[name, name], panel.lines[name, REFERENCE]
    return [
        world(name),
        f"{home['tracked']:.2f}",
        interval(reference, "tracked", 2),
        interval(reference, "retention", 2),
        f"{_mean_kept(panel, name):.2f}",
        f"{min(line['retention'] for line in away):.2f}",
        f"{min(line['held'] for line in away):.2f}",
        interval(reference, "floor", 2),
    ]


def _mean_kept(panel: Panel, name: str) -> float:
    away = [panel.lines[name, other]["retention"] for other in panel.deploy if other != name]
    return sum(away) / len(away)
