"""Learning curves of the circle: both learners, and all observations."""

from collections.abc import Mapping
from dataclasses import dataclass

from matplotlib.ticker import MaxNLocator

from leaderboard._chart import Panel, Series, Ticks, chart, colors
from leaderboard.curves import Band, band
from leaderboard.publish.blocks.learning import STEPS, compared, observed
from leaderboard.publish.kept import Kept
from leaderboard.publish.pictures.copies import IMAGES
from leaderboard.publish.registry import picture
from leaderboard.publish.words import shown
from leaderboard.tables import Line

SIGNALS = {
    "p_err_cm": "error of the lower end [cm]",
    "q_err_deg": "error of the axis [deg]",
}
"""Signals of a learning curve, and what they are."""


@picture(f"{IMAGES}/learners.svg")
def learners(kept: Kept) -> bytes:
    """Both learners in every engine."""
    engines, algos = compared(kept)
    lines = {
        f"{algo} in {shown(backend)}": kept.line("circle", backend=backend, algo=algo, steps=STEPS)
        for backend in engines
        for algo in algos
    }
    hues = colors([shown(backend) for backend in engines])
    drawn = {
        name: _Drawn(color=hues[name.split(" in ")[1]], dashed=not name.startswith(f"{algos[0]} "))
        for name in lines
    }
    return _curves(lines, drawn, "Learning curves of two learners in three engines")


@picture(f"{IMAGES}/observations.svg")
def observations(kept: Kept) -> bytes:
    """All observations on the reference."""
    names = observed(kept)["observation"].unique()
    lines = {name: kept.line("circle", observation=name, steps=STEPS) for name in names}
    drawn = {name: _Drawn(color=hue) for name, hue in colors(list(lines)).items()}
    return _curves(lines, drawn, "Learning curves of the observations")


@dataclass(frozen=True, kw_only=True)
class _Drawn:
    """How the curve of a policy looks."""

    color: str
    dashed: bool = False


def _curves(lines: Mapping[str, Line], drawn: Mapping[str, _Drawn], title: str) -> bytes:
    panels = []
    for signal, label in SIGNALS.items():
        bands = {name: _band(line, signal) for name, line in lines.items()}
        series = [_series(name, drawn[name], found) for name, found in bands.items()]
        panels.append(_panel(label, list(bands.values()), series))
    return chart(panels, len(panels), f"{title}: mean over seeds, and least to most")


def _band(line: Line, signal: str) -> Band:
    curves = [row.curve for row in line.rows if row.curve is not None]
    return band([(curve.steps, getattr(curve, signal)) for curve in curves])


def _series(label: str, drawn: _Drawn, found: Band) -> Series:
    steps, mean, low, high = (
        list(map(float, values)) for values in (found.steps, found.mean, found.low, found.high)
    )
    return Series(
        label=label,
        color=drawn.color,
        dashed=drawn.dashed,
        x=steps,
        y=mean,
        low=low,
        high=high,
    )


def _panel(label: str, bands: list[Band], series: list[Series]) -> Panel:
    ticks = MaxNLocator(5).tick_values(0, max(float(found.high.max()) for found in bands))
    most = max(float(found.steps[-1]) for found in bands)
    locator = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10])
    steps = [tick for tick in locator.tick_values(0, most) if tick <= most]
    return Panel(
        title=label,
        x=Ticks(
            label="environment steps, in millions",
            ends=(0.0, most),
            at=[(tick, f"{tick / 1e6:g}") for tick in steps],
        ),
        y=Ticks(label="", ends=(ticks[0], ticks[-1]), at=[(tick, f"{tick:g}") for tick in ticks]),
        series=series,
    )
