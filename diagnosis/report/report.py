"""The report of a diagnosis: one self-contained HTML page that fetches nothing."""

import sys
from collections.abc import Mapping
from itertools import groupby

from jinja2 import Environment, PackageLoader, StrictUndefined
from plotly.offline import get_plotlyjs

from backends.effect import Effect
from diagnosis.attribution.attribute import Ranked
from diagnosis.attribution.evidence import USED
from diagnosis.attribution.gather import FREE_AIR, LEAST_SAMPLES
from diagnosis.attribution.locate import PHASES, Place
from diagnosis.attribution.rules import rules
from diagnosis.attribution.verdict import NONE, UNKNOWN, LimbVerdict
from diagnosis.diagnose import Diagnosis
from diagnosis.finding import Finding, Spot
from diagnosis.logs.log import Log
from diagnosis.motion.held import PROTOCOLS as HELD
from diagnosis.report import wording
from diagnosis.report._figures import overlays, shrinking

LARGEST = 8
"""Number of parts of the gap that are listed with all their numbers."""
MOVED = 1.0
"""Nominal parameters that moved by at least this many prior standard deviations are named."""
FAINT = 0.001
"""Shares below this are left blank."""


def page(found: Diagnosis, log: Log, facts: Mapping[str, str], commands: Mapping[str, str]) -> str:
    """The report as HTML.

    `facts` say what was diagnosed and with which nominal world. `commands` are the commands that
    use the verdict, with what each does; they are empty if no effect was found or none can be
    added.
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
        facts=facts,
        commands=commands,
        quiet=found.gap_before <= rules().settled_gap,
        heat=_heat(found.where, log),
        largest=[p for p in found.where if p.share >= FAINT][:LARGEST],
        limbs=[_limb(limb) for limb in found.limbs],
        fingers=_fingers(found.spots),
        beside=[(one, _size(one, found)) for one in found.beside],
        overlays=list(overlays(found)),
        shrinking=shrinking(found),
        episodes=[_episode(log, e.episode, e.protocol) for e in log.episodes],
        channels=_channels(log),
        warnings=log.warnings,
        rules=rules(),
    )


def _heat(where: tuple[Place, ...], log: Log) -> dict:
    """Shares of the gap: a row per joint and channel, a column per protocol and phase."""
    protocols = dict.fromkeys(e.protocol for e in log.episodes)
    there = {(p.protocol, p.phase) for p in where}
    columns = [(a, b) for a in protocols for b in PHASES if (a, b) in there]
    shown = {(p.joint, p.channel) for p in where}
    rows = [(a, b) for a in log.joints for b in USED if (a, b) in shown]
    cells = {(p.joint, p.channel, p.protocol, p.phase): p for p in where}
    return {
        "protocols": [(name, len(list(group))) for name, group in groupby(columns, lambda c: c[0])],
        "phases": [phase for _, phase in columns],
        "rows": [(row, [_cell(cells.get((*row, *column))) for column in columns]) for row in rows],
    }


def _size(one: Finding, found: Diagnosis) -> str:
    """The magnitude of a finding; empty for an unknown one."""
    said = [m for m in found.magnitudes if (m.effect, m.joint) == (one.effect, one.joint)]
    return wording.size(said[0]) if said else ""


def _fingers(spots: tuple[Spot, ...]) -> dict:
    """Gaps of touch and stick: a row per finger, a column per family."""
    families = list(dict.fromkeys(spot.family for spot in spots))
    cells = {(spot.finger, spot.family): spot for spot in spots}
    fingers = dict.fromkeys(spot.finger for spot in spots)
    return {
        "families": families,
        "rows": [(name, [cells.get((name, family)) for family in families]) for name in fingers],
    }


def _cell(place: Place | None) -> dict:
    if place is None or place.share < FAINT:
        return {"share": "", "interval": "", "strength": 0.0, "said": ""}
    low, high = (100 * end for end in place.share_interval)
    return {
        "share": f"{100 * place.share:.1f}",
        "interval": f"{low:.1f}–{high:.1f}",
        "strength": round(place.share**0.5, 3),
        "said": f"{place.rms / place.noise:.3g} times the noise, {place.samples} samples",
    }


def _limb(limb: LimbVerdict) -> dict:
    """One limb's candidates, best first, and the shifts of its nominal parameters."""
    attribution = limb.attribution
    tried, tied = limb.ranking, {(one.names, one.joints) for one in limb.tied}
    widest = max(1.0, *(one.gap for one in tried))
    settled = limb.names in ((NONE,), (UNKNOWN,))
    moved = zip(attribution.fitter.nuisances, limb.chosen.fit.deviations, strict=True)
    return {
        "joints": attribution.fitter.evidence.joints,
        "names": limb.names,
        "accused": limb.names != (NONE,),
        "candidates": [
            {
                "name": wording.candidate(one),
                "meaning": _meaning(one),
                "size": wording.amounts(one),
                "behind": one.fit.cost - tried[0].fit.cost,
                "gap": one.gap,
                "width": 100 * one.gap / widest,
                "chosen": one is limb.chosen and not settled,
                "tied": (one.names, one.joints) in tied,
            }
            for one in tried
        ],
        "moved": [
            f"{_name(n.at(d))}{f'@{n.joint}' if n.joint else ''} "
            f"{wording.amount(n.at(d))} ({d:+.1f} prior sd)"
            for n, d in moved
            if abs(d) >= MOVED
        ],
    }


def _name(effect: Effect) -> str:
    """An effect's name, which is that of its file."""
    return type(effect).__module__.rsplit(".", 1)[-1].replace("_", "-")


def _meaning(ranked: Ranked) -> str:
    """What its effects are: the first lines of their files."""
    texts = (sys.modules[type(e).__module__].__doc__ or "" for e in ranked.fit.effects)
    return " ".join(text.strip().splitlines()[0] for text in texts)


def _episode(log: Log, number: int, protocol: str) -> dict:
    """How an episode was used."""
    frame = log.episode(number)
    use = "used"
    if protocol in HELD:
        seen = log.stick(number) is not None
        use = "used for touch and stick" if seen else "left out: the stick's pose is missing"
    elif protocol == "pull":
        seen = log.stick(number) is not None and log.pull(number) is not None
        use = (
            "used for friction and mass"
            if seen
            else "left out: the stick's pose or the pull is missing"
        )
    elif protocol not in FREE_AIR:
        use = "left out: not in free air"
    elif len(frame) < LEAST_SAMPLES:
        use = f"left out: fewer than {LEAST_SAMPLES} samples"
    return {
        "number": number,
        "protocol": protocol,
        "samples": len(frame),
        "seconds": float(frame["t_s"].iloc[-1] - frame["t_s"].iloc[0]),
        "use": use,
    }


def _channels(log: Log) -> list[str]:
    """Channels that were compared or applied; where only some joints have one, they are named."""
    found = []
    for kind in (*USED, "push"):
        joints = [joint for joint in log.joints if log.has(kind, joint)]
        if joints:
            found.append(
                kind if len(joints) == len(log.joints) else f"{kind} ({', '.join(joints)})"
            )
    stick = any(log.stick(e.episode) is not None for e in log.episodes)
    pull = any(log.pull(e.episode) is not None for e in log.episodes)
    return [*found, *["touch"] * bool(log.fingers), *["stick"] * stick, *["pull"] * pull]
