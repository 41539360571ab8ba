"""Figures of a diagnosis: measured and simulated signals with residuals.

They are HTML fragments that draw themselves with plotly.js, which their page must contain once.
"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from backends.state import Array
from diagnosis.signals import Signals

MEASURED = "#1c1c1c"
COLORS = ("#d9822b", "#7a9e3f", "#2b6cb0")
"""Of the nominal world, of refitted nominal numbers, and with causes."""
UNITS = {False: ("deg", float(np.degrees(1.0)), "Nm"), True: ("mm", 1e3, "N")}
"""Unit of positions and its size, and unit of torques: for hinges (False) and slides (True)."""
DIGITS = 5
_CONFIG = {"displayModeBar": False, "responsive": True}
_LAYOUT = {
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": MEASURED},
    "margin": {"l": 60, "r": 16, "t": 46, "b": 44},
    "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
    "height": 440,
    "hovermode": "x unified",
}
_AXIS = {"gridcolor": "#ebf0f8", "zerolinecolor": "#ebf0f8", "automargin": True}
_DIV = """<div id="{0}" class="plotly-graph-div" style="height:440px"></div>
<script>Plotly.newPlot("{0}", {1}, {2}, {3})</script>"""


def overlay(one: Signals, name: str) -> str:
    """Measured and simulated signals of one joint, and what is left; under `name` on its page."""
    angle, scale, torque = UNITS[one.slides]
    unit, scale = (torque, 1.0) if one.channel == "torque" else (angle, scale)
    floor = 2.0 * scale * one.floor
    band = {
        "type": "rect",
        "xref": "x domain",
        "yref": "y2",
        "x0": 0,
        "x1": 1,
        "line": {"width": 0},
    }
    layout = _LAYOUT | {
        "xaxis": _AXIS | {"matches": "x2", "showticklabels": False},
        "xaxis2": _AXIS | {"anchor": "y2", "title": {"text": "time [s]"}},
        "yaxis": _AXIS | {"domain": [0.43, 1.0], "title": {"text": f"{one.channel} [{unit}]"}},
        "yaxis2": _AXIS | {"domain": [0.0, 0.38], "title": {"text": f"residual [{unit}]"}},
        "shapes": [band | {"y0": -floor, "y1": floor, "fillcolor": "#999", "opacity": 0.25}],
    }
    parts = list(_lines(one, scale)), layout, _CONFIG
    return _DIV.format(name, *map(json.dumps, parts))


def _lines(one: Signals, scale: float) -> Iterator[dict[str, Any]]:
    measured = np.array(one.measured)
    yield _line(one, "measured", scale * measured, MEASURED)
    for (name, line), color in zip(one.simulated.items(), COLORS, strict=False):
        yield _line(one, name, scale * np.array(line), color)
        yield _line(one, name, scale * (measured - line), color) | {
            "xaxis": "x2",
            "yaxis": "y2",
            "showlegend": False,
        }


def _line(one: Signals, name: str, values: Array, color: str) -> dict[str, Any]:
    width = 2.4 if name == "measured" else 1.4
    return {
        "x": one.time_s,
        "y": [float(f"{value:.{DIGITS}g}") for value in values],
        "name": name,
        "legendgroup": name,
        "mode": "lines",
        "line": {"color": color, "width": width},
    }
