"""Figures of a diagnosis: measured and simulated signals with residuals.

They are HTML fragments; their page must contain plotly.js once.
"""

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from backends.state import Array
from diagnosis.signals import Signals

MEASURED = "#1c1c1c"
COLORS = ("#d9822b", "#7a9e3f", "#2b6cb0")
"""Of the nominal world, of refitted nominal numbers, and with causes."""
UNITS = {False: ("deg", float(np.degrees(1.0)), "Nm"), True: ("mm", 1e3, "N")}
"""Unit of positions and its size, and unit of torques: for hinges (False) and slides (True)."""
_CONFIG = {"displayModeBar": False, "responsive": True}
_LAYOUT = {
    "template": "plotly_white",
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": MEASURED},
    "margin": {"l": 60, "r": 16, "t": 46, "b": 44},
    "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
}


def overlay(one: Signals) -> str:
    """Measured and simulated signals of one joint, and what is left of each."""
    angle, scale, torque = UNITS[one.slides]
    unit, scale = (torque, 1.0) if one.channel == "torque" else (angle, scale)
    time_s, measured = np.array(one.time_s), scale * np.array(one.measured)
    lines = {name: scale * np.array(line) for name, line in one.simulated.items()}
    colors = dict(zip(lines, COLORS, strict=False))
    figure = make_subplots(2, 1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.05)
    _line(figure, 1, (time_s, measured), "measured", MEASURED)
    for name, line in lines.items():
        _line(figure, 1, (time_s, line), name, colors[name])
        _line(figure, 2, (time_s, measured - line), name, colors[name])
    floor = scale * one.floor
    band = {"fillcolor": "#999", "opacity": 0.25, "line_width": 0, "row": 2, "col": 1}
    figure.add_hrect(y0=-2 * floor, y1=2 * floor, **band)
    figure.update_layout(**_LAYOUT, height=440, hovermode="x unified")
    figure.update_xaxes(title="time [s]", row=2, col=1)
    figure.update_yaxes(title=f"{one.channel} [{unit}]", row=1, col=1)
    figure.update_yaxes(title=f"residual [{unit}]", row=2, col=1)
    return figure.to_html(full_html=False, include_plotlyjs=False, config=_CONFIG)


def _line(figure: go.Figure, row: int, points: tuple[Array, Array], name: str, color: str) -> None:
    time_s, values = (v.astype(np.float32) for v in points)
    style = {"color": color, "width": 2.4 if name == "measured" else 1.4}
    shown = {"name": name, "line": style, "showlegend": row == 1, "legendgroup": name}
    figure.add_scatter(x=time_s, y=values, row=row, col=1, **shown)
