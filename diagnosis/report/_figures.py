"""Figures of a diagnosis: measured and simulated signals with residuals, and how the gap shrinks.

The figures are HTML fragments; their page must contain plotly.js once.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from backends.state import Array
from diagnosis.attribution.evidence import USED, Evidence
from diagnosis.attribution.verdict import NONE, UNKNOWN, LimbVerdict
from diagnosis.diagnose import Diagnosis
from diagnosis.replay.replay import CHANNELS, replay
from diagnosis.report.wording import BEST, VERDICT, after_name

EXCERPT_S = 3.0
"""Length of the excerpt that is shown first, around the largest residual of the nominal world
[s]."""
COLORS = {
    "measured": "#1c1c1c",
    "nominal": "#d9822b",
    "nominal parameters refitted": "#7a9e3f",
    f"with {VERDICT}": "#2b6cb0",
    f"with {BEST}": "#2b6cb0",
}
UNITS = {False: ("deg", float(np.degrees(1.0)), "Nm"), True: ("mm", 1e3, "N")}
"""Unit of positions and its size, and unit of torques: for hinges (False) and slides (True)."""
_CONFIG = {"displaylogo": False, "responsive": True}
_LAYOUT = {
    "template": "plotly_white",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": "#1c1c1c"},
    "margin": {"l": 60, "r": 16, "t": 46, "b": 44},
    "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
}


@dataclass(frozen=True, kw_only=True)
class Overlay:
    """Signals of one joint in the episode with the largest residual of the nominal world."""

    joint: str
    channel: str
    protocol: str
    html: str


def overlays(found: Diagnosis) -> Iterator[Overlay]:
    """An overlay per joint of the verdict; without one, of the joint with the largest gap."""
    wanted = found.joints or tuple(place.joint for place in found.where[:1])
    for limb in found.limbs:
        evidence = _shown(limb.told or limb)
        for j, joint in enumerate(evidence.joints):
            if joint in wanted:
                number, channel = _worst(evidence, j)
                figure = _overlay(limb, j, number, channel)
                yield Overlay(
                    joint=joint,
                    channel=USED[channel],
                    protocol=evidence.recordings[number].protocol,
                    html=_html(figure),
                )


def _shown(limb: LimbVerdict) -> Evidence:
    """The setting under which a limb is shown: the first one with samples held out from fits."""
    settings = limb.attribution.fitter.evidence.settings
    return next(one for one in settings if any(r.judged.any() for r in one.recordings))


def shrinking(found: Diagnosis) -> str:
    """The held-out gap before and after, with the noise floor."""
    names = {
        "before": "nominal world",
        "nominal": "nominal parameters refitted",
        "after": f"with {after_name(found)}",
    }
    if found.verdict == (NONE,):
        del names["after"]
    shades = [COLORS[name] for name in list(COLORS)[1:]]
    figure = go.Figure()
    for (key, name), color in zip(names.items(), shades, strict=False):
        gap = found.gaps[key]
        low, high = gap.interval
        error = {"array": [high - gap.value], "arrayminus": [gap.value - low], "color": "#1c1c1c"}
        figure.add_bar(
            x=[gap.value],
            y=[f"{name}<br><b>{gap.value:.3g}</b>"],
            orientation="h",
            marker_color=color,
            error_x={"type": "data", "symmetric": False, **error},
        )
    figure.add_vline(x=found.noise_floor, line_dash="dash", line_color="#555")
    figure.add_annotation(
        x=found.noise_floor,
        y=1.0,
        yref="paper",
        yanchor="bottom",
        text="noise floor",
        showarrow=False,
    )
    figure.update_layout(**_LAYOUT, height=230, showlegend=False, bargap=0.35)
    figure.update_yaxes(autorange="reversed")
    figure.update_xaxes(title="held-out gap [standard deviations]", rangemode="tozero")
    return _html(figure)


def _worst(evidence: Evidence, joint: int) -> tuple[int, int]:
    """Episode and channel with the largest residual of the nominal world, relative to the noise."""
    rows = [CHANNELS.index(name) for name in USED]
    size = np.full((len(evidence.recordings), len(USED)), -1.0)
    for number, recording in enumerate(evidence.recordings):
        residual = recording.measured - replay(evidence.nominal, recording.commands)[rows]
        square = (residual / evidence.sigma)[:, :, joint] ** 2
        logged = np.isfinite(square).any(axis=1)
        size[number, logged] = np.nanmean(square[logged], axis=1)
    return divmod(int(np.argmax(size)), len(USED))


def _overlay(limb: LimbVerdict, joint: int, number: int, channel: int) -> go.Figure:
    evidence = _shown(limb.told or limb)
    recording = evidence.recordings[number]
    angle, size, torque = UNITS[evidence.nominal.hand.driven[joint].joint.slides]
    unit, size = (torque, 1.0) if USED[channel] == "torque" else (angle, size)
    time_s = recording.commands.ticks * evidence.nominal.timing.drive_s
    measured = size * recording.measured[channel, :, joint]
    lines = {name: size * line for name, line in _signals(limb, joint, number, channel).items()}
    figure = make_subplots(2, 1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.05)
    for name, line in {"measured": measured, **lines}.items():
        style = {"color": COLORS[name], "width": 2.4 if name == "measured" else 1.4}
        figure.add_scatter(x=_small(time_s), y=_small(line), name=name, line=style, row=1, col=1)
    floor = size * float(evidence.sigma[channel, 0, joint])
    figure.add_hrect(
        y0=-2 * floor, y1=2 * floor, fillcolor="#999", opacity=0.25, line_width=0, row=2, col=1
    )
    for name, line in lines.items():
        style = {"color": COLORS[name], "width": 1.4}
        figure.add_scatter(
            x=_small(time_s),
            y=_small(measured - line),
            name=name,
            line=style,
            showlegend=False,
            row=2,
            col=1,
        )
    figure.update_layout(**_LAYOUT, height=440, hovermode="x unified")
    begin_s, end_s = _excerpt(time_s, measured - lines["nominal"])
    inside = (time_s >= begin_s) & (time_s <= end_s)
    figure.update_xaxes(range=[begin_s, end_s])
    figure.update_yaxes(range=_around([measured, *lines.values()], inside), row=1, col=1)
    residuals = [measured - line for line in lines.values()]
    floors = [np.full(len(time_s), sign * 2.5 * floor) for sign in (-1, 1)]
    figure.update_yaxes(range=_around([*residuals, *floors], inside), row=2, col=1)
    figure.update_xaxes(title="time [s]", row=2, col=1)
    figure.update_yaxes(title=f"{USED[channel]} [{unit}]", row=1, col=1)
    figure.update_yaxes(title=f"residual [{unit}]", row=2, col=1)
    return figure


def _signals(limb: LimbVerdict, joint: int, number: int, channel: int) -> dict[str, Array]:
    """The signals of one joint in the nominal, the refitted and the verdict's world.

    Where commands were lost, the verdict's world gets only those that arrived.
    """
    told = limb.told or limb
    fits = {
        "nominal": (told, told.attribution.before.fit),
        "nominal parameters refitted": (told, told.attribution.nominal.fit),
    }
    if limb.names != (NONE,) or limb.told:
        fits[f"with {BEST if limb.names == (UNKNOWN,) else VERDICT}"] = (limb, limb.chosen.fit)
    row = CHANNELS.index(USED[channel])
    shown = {}
    for name, (one, fit) in fits.items():
        evidence = _shown(one)
        pairs = zip(one.attribution.fitter.nuisances, fit.deviations, strict=True)
        world = evidence.world([*(n.at(d) for n, d in pairs if d != 0.0), *fit.effects])
        shown[name] = replay(world, evidence.recordings[number].commands)[row, :, joint]
    return shown


def _excerpt(time_s: Array, residual: Array) -> list[float]:
    worst_s = time_s[int(np.nanargmax(np.abs(residual)))]
    begin_s = float(np.clip(worst_s - EXCERPT_S / 2, 0, max(time_s[-1] - EXCERPT_S, 0)))
    return [begin_s, min(begin_s + EXCERPT_S, float(time_s[-1]))]


def _around(lines: list[Array], inside: Array) -> list[float]:
    """An axis range that contains the lines within an excerpt."""
    values = np.concatenate([line[inside] for line in lines])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    margin = 0.06 * max(high - low, 1e-6)
    return [low - margin, high + margin]


def _small(values: Array) -> Array:
    return values.astype(np.float32)


def _html(figure: go.Figure) -> str:
    return figure.to_html(full_html=False, include_plotlyjs=False, config=_CONFIG)
