"""The report of a diagnosis: one self-contained HTML page that fetches nothing.

It is made from the answer as plain data and the log, so it can be made again from diagnosis.json.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from itertools import groupby

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from backends.catalogue import catalogue
from diagnosis.answer import Diagnosis
from diagnosis.logs._columns import SHOWN
from diagnosis.logs.log import EpisodeMeta, Log
from diagnosis.models.loops import TERMS
from diagnosis.motion.held import PROTOCOLS as HELD
from diagnosis.motion.recordings import CHANNELS, FREE_AIR
from diagnosis.report import wording
from diagnosis.signals import Signals
from diagnosis.verdict.result import NONE, UNKNOWN, Ranked
from diagnosis.verdict.sentences import FROM, named
from diagnosis.where import PHASES, Place

LARGEST = 8
"""Number of parts of the gap that are listed with all their numbers."""
FAINT = 0.001
"""Shares below this are left blank."""
QUIET = 1.5
"""A smaller gap is not worth a map [noise floors]."""
MEASURED = "#1c1c1c"
COLORS = ("#d9822b", "#7a9e3f", "#2b6cb0")
"""Of the nominal world, of refitted nominal numbers, and with causes."""
_CONFIG = {"displayModeBar": False, "responsive": True}
_LAYOUT = {
    "template": "plotly_white",
    "paper_bgcolor": "rgba(0,0,0,0)",
    "plot_bgcolor": "rgba(0,0,0,0)",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": MEASURED},
    "margin": {"l": 60, "r": 16, "t": 46, "b": 44},
    "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
}


@dataclass(frozen=True, kw_only=True)
class Part:
    """One part of the bar of shares."""

    name: str
    share: float
    kind: str
    """Its colour: `nominal`, `cause`, `second` or `left`."""


def page(
    found: Diagnosis,
    log: Log,
    facts: Mapping[str, str] | None = None,
    commands: Mapping[str, str] | None = None,
) -> str:
    """The report of a diagnosis as one HTML page.

    `facts` say what was diagnosed, `log` its name, and with which nominal world. `commands` use the
    verdict, with what each does.
    """
    environment = Environment(
        loader=PackageLoader("diagnosis.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("_report.html.jinja").render(
        plotly=get_plotlyjs(),
        found=found,
        words=wording,
        named=named,
        ordinary=f"{FROM[found.ordinary_from]} {found.ordinary:.1f}",
        facts={"log": "a log", "source": log.meta.source} | dict(facts or {}),
        commands=commands,
        parts=parts(found),
        quiet=found.gaps.before.value <= QUIET,
        heat=_heat(found.where, log),
        largest=[p for p in found.where if p.share >= FAINT][:LARGEST],
        meaning=_meaning,
        faint=FAINT,
        spots={(spot.finger, spot.family): spot for spot in found.spots},
        fingers=list(dict.fromkeys(spot.finger for spot in found.spots)),
        families=list(dict.fromkeys(spot.family for spot in found.spots)),
        held=[one for one in found.magnitudes if one.evidence],
        overlays=[(one, overlay(one)) for one in found.signals],
        episodes=[(e, list(log.episode(e.episode)["t_s"]), _use(log, e)) for e in log.episodes],
        channels=_channels(log),
        warnings=log.warnings,
    )


def notebook(found: Diagnosis) -> str:
    """A diagnosis as a notebook shows it: the sentences, the shares of the gap, the sizes.

    A piece of HTML that follows the notebook's colours.
    """
    first, *rest = found.sentences
    shares = ", ".join(f"{one.name} {100 * one.share:.0f} %" for one in parts(found))
    rest += [f"Probability: {wording.probability(found)}. Of the gap: {shares}."]
    sizes = "; ".join(map(named, found.magnitudes))
    rest += [f"{sizes}. Brackets hold 90 % intervals."] if sizes else []
    lines = "".join(f"<p>{escape(text)}</p>" for text in rest)
    return f"<div><p><b>{escape(first)}</b></p>{lines}</div>"


def parts(found: Diagnosis) -> list[Part]:
    """What takes which share of the squared gap beyond one floor.

    Where nothing is named: the nominal numbers, refitted, and the rest. Else the causes, of what
    these numbers leave.
    """
    nominal = found.shrinkage_nominal.value
    if found.verdict == (NONE,):
        taken = min(max(nominal, 0.0), 1.0)
        shares = [Part(name="nominal numbers", share=taken, kind="nominal")]
    else:
        after = (1.0 - found.shrinkage.value) / max(1.0 - nominal, 1e-9)
        taken = min(max(1.0 - after, 0.0), 1.0)
        shares = list(_causes(found, taken))
    shares.append(Part(name="left", share=1.0 - taken, kind="left"))
    return [part for part in shares if part.share > FAINT]


def _causes(found: Diagnosis, taken: float) -> Iterator[Part]:
    """What causes take together, split by what each takes by itself."""
    if found.verdict == (UNKNOWN,) or not found.magnitudes:
        yield Part(name="leading causes", share=taken, kind="second")
        return
    own = [max(cause.share, 0.0) for cause in found.magnitudes]
    for number, (cause, share) in enumerate(zip(found.magnitudes, own, strict=True)):
        part, kind = taken * share / max(sum(own), 1e-9), "second" if number else "cause"
        yield Part(name=wording.place(cause), share=part, kind=kind)


def _heat(where: tuple[Place, ...], log: Log) -> dict:
    """Shares of the gap: a row per joint and channel, a column per protocol and phase."""
    cells = {(p.joint, p.channel, p.protocol, p.phase): p for p in where}
    shown, there = {key[:2] for key in cells}, {key[2:] for key in cells}
    protocols = dict.fromkeys(e.protocol for e in log.episodes)
    columns = [(a, b) for a in protocols for b in PHASES if (a, b) in there]
    return {
        "cells": cells,
        "rows": [(a, b) for a in log.joints for b in CHANNELS if (a, b) in shown],
        "columns": columns,
        "protocols": [(name, len(list(group))) for name, group in groupby(columns, lambda c: c[0])],
    }


def _meaning(one: Ranked) -> str:
    """What its effects are: the first lines of their docstrings."""
    known = {**catalogue(), **{one.name: one for one in TERMS}}
    texts = (known[name].__doc__ or "" for name, _ in one.causes if name in known)
    return " ".join(text.strip().splitlines()[0] for text in texts if text.strip())


def _use(log: Log, one: EpisodeMeta) -> str:
    """How an episode was used."""
    seen = log.stick(one.episode) is not None
    if one.protocol in HELD:
        return "used for touch and stick" if seen else "left out: the stick's pose is missing"
    if one.protocol == "pull":
        if seen and log.pull(one.episode) is not None:
            return "used for friction and mass"
        return "left out: the stick's pose or the pull is missing"
    return "used" if one.protocol in FREE_AIR else "left out: not in free air"


def _channels(log: Log) -> list[str]:
    """Channels that were compared or applied; where only some joints have one, they are named."""
    found = []
    for kind in (*CHANNELS, "push"):
        joints = [joint for joint in log.joints if log.has(kind, joint)]
        some = f" ({', '.join(joints)})" if len(joints) < len(log.joints) else ""
        found += [kind + some] * bool(joints)
    numbers = [episode.episode for episode in log.episodes]
    held = {"stick": log.stick, "pull": log.pull}
    seen = [kind for kind, of in held.items() if any(of(n) is not None for n in numbers)]
    return [*found, *["touch"] * bool(log.fingers), *seen]


def overlay(one: Signals) -> str:
    """Measured and simulated signals of one joint, and what is left of each, as HTML."""
    scale, angle, torque = SHOWN[one.slides]
    unit, scale = (torque, 1.0) if one.channel == "torque" else (angle, scale)
    time_s, measured = np.array(one.time_s, np.float32), scale * np.array(one.measured)
    drawn = [(1, "measured", measured, MEASURED)]
    for (name, shown), color in zip(one.simulated.items(), COLORS, strict=False):
        line = scale * np.array(shown)
        drawn += [(1, name, line, color), (2, name, measured - line, color)]
    figure = make_subplots(2, 1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.05)
    for row, name, values, color in drawn:
        style = {"color": color, "width": 2.4 if name == "measured" else 1.4}
        about = {"name": name, "line": style, "showlegend": row == 1, "legendgroup": name}
        figure.add_scatter(x=time_s, y=values.astype(np.float32), row=row, col=1, **about)
    floor = scale * one.floor
    band = {"fillcolor": "#999", "opacity": 0.25, "line_width": 0, "row": 2, "col": 1}
    figure.add_hrect(y0=-2 * floor, y1=2 * floor, **band)
    figure.update_layout(**_LAYOUT, height=440, hovermode="x unified")
    figure.update_xaxes(title="time [s]", row=2, col=1)
    figure.update_yaxes(title=f"{one.channel} [{unit}]", row=1, col=1)
    figure.update_yaxes(title=f"residual [{unit}]", row=2, col=1)
    return figure.to_html(full_html=False, include_plotlyjs=False, config=_CONFIG)
