"""Small drawings for the page as SVG text: intervals next to figures, and learning curves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.ticker import MaxNLocator

from leaderboard.curves import Band

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#444444")
"""Colours that are distinguishable with colour vision deficiency (Okabe and Ito)."""
CELL_W, CELL_H, PAD = 100, 18, 5
PLOT_W, PLOT_H, LEFT, BOTTOM, TOP = 420, 216, 46, 36, 10


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One figure of one policy."""

    value: float
    low: float
    high: float
    """NaN without an interval."""
    seeds: Sequence[float]
    """The value of each seed."""
    color: str


def cell(shown: Cell, most: float, mark: float | None = None) -> str:
    """A scale from 0 to `most`: seeds are dots, the mean is a stroke, the interval a bar.

    `mark` is the value of the paper, drawn as a dashed line.
    """

    def at(value: float) -> str:
        return f"{PAD + (CELL_W - 2 * PAD) * min(value / most, 1) if most > 0 else PAD:.1f}"

    mid = CELL_H / 2
    parts = [f'<path class="axis" d="M{PAD} {mid}H{CELL_W - PAD}"/>']
    if not np.isnan(shown.low):
        parts.append(f'<path class="bar" d="M{at(shown.low)} {mid}H{at(shown.high)}"/>')
    parts += [f'<circle cx="{at(value)}" cy="{mid}" r="2.4"/>' for value in shown.seeds]
    parts.append(f'<path class="mean" d="M{at(shown.value)} {mid - 7}v14"/>')
    if mark is not None:
        parts.append(f'<path class="paper" d="M{at(mark)} 0v{CELL_H}"/>')
    size = f'width="{CELL_W}" height="{CELL_H}"'
    return f'<svg {size} style="color:{shown.color}">{"".join(parts)}</svg>'


def plot(bands: Sequence[tuple[str, Band]], label: str, from_zero: bool) -> str:
    """Bands in their colours over steps, with axes; `label` names the signal."""
    most_steps = max(band.steps[-1] for _, band in bands)
    low = 0.0 if from_zero else min(band.low.min() for _, band in bands)
    ticks = MaxNLocator(4).tick_values(low, max(band.high.max() for _, band in bands))
    low, high = ticks[0], ticks[-1]
    width, height = PLOT_W - LEFT - 14, PLOT_H - BOTTOM - TOP

    def at(steps: np.ndarray, values: np.ndarray) -> str:
        x = LEFT + width * steps / most_steps
        y = TOP + height * (high - values) / (high - low)
        return "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))

    parts = []
    for tick in ticks:
        y = TOP + height * (high - tick) / (high - low)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}h{width}"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for tick in MaxNLocator(4).tick_values(0, most_steps):
        if tick <= most_steps:
            x = LEFT + width * tick / most_steps
            text = f"{tick / 1e6:g}M" if tick else "0"
            parts.append(f'<text x="{x:.1f}" y="{PLOT_H - 20}" text-anchor="middle">{text}</text>')
    for hue, band in bands:
        if band.seeds > 1:
            outline = f"{at(band.steps, band.high)}L{at(band.steps[::-1], band.low[::-1])}"
            parts.append(f'<path fill="{hue}" fill-opacity=".2" d="M{outline}Z"/>')
        parts.append(f'<path class="curve" stroke="{hue}" d="M{at(band.steps, band.mean)}"/>')
    caption = f'<text x="{LEFT}" y="{PLOT_H - 5}">{label} over environment steps</text>'
    return f'<svg viewBox="0 0 {PLOT_W} {PLOT_H}" width="{PLOT_W}">{"".join(parts)}{caption}</svg>'
