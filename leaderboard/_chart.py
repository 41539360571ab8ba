"""Charts as SVG text: panels with axes, lines, bands and dots, and one legend below them.

Drawn by hand rather than by a plotting library, so that equal results give equal bytes whatever
library and processor draw them. Positions are rounded to a tenth of a pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np

from leaderboard._svg import COLORS

WIDTH, HEIGHT = 300, 220
"""Of a panel's drawing area, without its labels [pixels]."""
LEFT, RIGHT, TOP, BOTTOM = 52, 24, 30, 44
"""Room around it for title, ticks and labels [pixels]."""
LEGEND_H, LEGEND_W = 20, 300
"""Height and width of an entry of the legend [pixels]."""
STYLE = (
    "text{font:12px sans-serif;fill:#222}.grid{stroke:#ddd}.axis{stroke:#888;fill:none}"
    ".wanted{stroke:#888;stroke-dasharray:2 3}"
)


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values over an axis, with a range around each where one is known."""

    label: str
    color: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None
    dots: bool = False
    """Dots with whiskers; else a line with a band."""
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Ticks:
    """An axis: what it is of, its ends, and where it is labelled."""

    label: str
    ends: tuple[float, float]
    at: Sequence[tuple[float, str]]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One drawing area."""

    title: str
    x: Ticks
    y: Ticks
    series: Sequence[Series]
    wanted: Sequence[float] = field(default=())
    """Values marked by a dotted line."""


def colors(labels: Sequence[str]) -> dict[str, str]:
    """A colour for each label."""
    return {label: COLORS[n % len(COLORS)] for n, label in enumerate(labels)}


def chart(panels: Sequence[Panel], columns: int, title: str) -> bytes:
    """Panels in rows of so many columns, as an SVG file."""
    whole_w, whole_h = WIDTH + LEFT + RIGHT, HEIGHT + TOP + BOTTOM
    width = columns * whole_w
    below = -(-len(panels) // columns) * whole_h
    legend, height = _legend(panels, below, width)
    drawn = [
        f'<g transform="translate({n % columns * whole_w} {n // columns * whole_h})">'
        f"{_panel(panel)}</g>"
        for n, panel in enumerate(panels)
    ]
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" role="img">',
        f"<title>{escape(title)}</title><style>{STYLE}</style>",
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        *drawn,
        *legend,
        "</svg>",
    ]
    return ("\n".join(lines) + "\n").encode()


def _panel(panel: Panel) -> str:
    parts = [f'<text x="{LEFT}" y="18" font-weight="bold">{escape(panel.title)}</text>']
    for value, text in panel.y.at:
        y = _y(panel, value)
        parts.append(f'<path class="grid" d="M{LEFT} {y}h{WIDTH}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    for value, text in panel.x.at:
        x, bottom = _x(panel, value), TOP + HEIGHT
        parts.append(f'<path class="axis" d="M{x} {bottom}v4"/>')
        parts.append(f'<text x="{x}" y="{bottom + 17}" text-anchor="middle">{text}</text>')
    parts += [
        f'<path class="wanted" d="M{LEFT} {_y(panel, value)}h{WIDTH}"/>' for value in panel.wanted
    ]
    parts.append(f'<path class="axis" d="M{LEFT} {TOP}v{HEIGHT}h{WIDTH}"/>')
    parts += [_dots(panel, s) if s.dots else _line(panel, s) for s in panel.series]
    middle = LEFT + WIDTH // 2
    label = f'x="{middle}" y="{TOP + HEIGHT + 36}" text-anchor="middle"'
    parts.append(f"<text {label}>{escape(panel.x.label)}</text>")
    across = f'transform="translate(12 {TOP + HEIGHT // 2}) rotate(-90)" text-anchor="middle"'
    parts.append(f"<text {across}>{escape(panel.y.label)}</text>")
    return "".join(parts)


def _line(panel: Panel, series: Series) -> str:
    parts = []
    if series.low is not None and series.high is not None:
        back = _path(panel, series.x[::-1], series.low[::-1])
        outline = f"M{_path(panel, series.x, series.high)}L{back}Z"
        parts.append(f'<path fill="{series.color}" fill-opacity=".15" d="{outline}"/>')
    dash = ' stroke-dasharray="5 4"' if series.dashed else ""
    line = f'd="M{_path(panel, series.x, series.y)}"'
    parts.append(f'<path fill="none" stroke="{series.color}" stroke-width="1.6"{dash} {line}/>')
    return "".join(parts)


def _dots(panel: Panel, series: Series) -> str:
    parts = []
    ends = zip(series.low or series.y, series.high or series.y, strict=True)
    for x, y, (low, high) in zip(series.x, series.y, ends, strict=True):
        whisker = f"M{_x(panel, x)} {_y(panel, low)}V{_y(panel, high)}"
        parts.append(f'<path stroke="{series.color}" stroke-opacity=".45" d="{whisker}"/>')
        dot = f'cx="{_x(panel, x)}" cy="{_y(panel, y)}" r="3.2"'
        parts.append(f'<circle {dot} fill="{series.color}"/>')
    return "".join(parts)


def _path(panel: Panel, xs: Sequence[float], ys: Sequence[float]) -> str:
    return "L".join(f"{_x(panel, x)} {_y(panel, y)}" for x, y in zip(xs, ys, strict=True))


def _x(panel: Panel, value: float) -> float:
    low, high = panel.x.ends
    return round(LEFT + WIDTH * (value - low) / (high - low), 1)


def _y(panel: Panel, value: float) -> float:
    low, high = panel.y.ends
    inside = float(np.clip(value, low, high))
    return round(TOP + HEIGHT * (high - inside) / (high - low), 1)


def _legend(panels: Sequence[Panel], below: int, width: int) -> tuple[list[str], int]:
    """Its entries under the panels, and the height of the whole."""
    entries = {series.label: series for panel in panels for series in panel.series}
    columns = max(1, width // LEGEND_W)
    parts = []
    for n, series in enumerate(entries.values()):
        x, y = LEFT + n % columns * LEGEND_W, below + 4 + n // columns * LEGEND_H
        dash = ' stroke-dasharray="5 4"' if series.dashed else ""
        mark = f'stroke="{series.color}" stroke-width="3"{dash} d="M{x} {y + 6}h22"'
        parts.append(f'<path {mark}/><text x="{x + 30}" y="{y + 10}">{escape(series.label)}</text>')
    return parts, below + 12 + -(-len(entries) // columns) * LEGEND_H
