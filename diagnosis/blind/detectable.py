"""The smallest detectable magnitudes, by bisection with the oracle on randomly drawn cases.

A magnitude is detectable if the oracle calls it so in at least half of the draws. A replay cannot
show noise, steps and lost packets; they are detectable if the solver names them and nothing else.
For touch, stick and contact, grasps with and without the effect must differ by the oracle's limit.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from backends.catalogue import catalogue
from backends.effect import UNITS, Effect
from diagnosis.blind import draw, rigs
from diagnosis.blind.apart import SKIN, Grasps
from diagnosis.blind.draw import Case
from diagnosis.blind.faults import Fault
from diagnosis.blind.make import Simulate, real_log
from diagnosis.blind.oracle import DETECTABLE_NATS, detectable
from diagnosis.blind.tables import markdown
from diagnosis.logs.log import Log, LogError
from diagnosis.walk import diagnose

BELOW = 8.0
"""The search begins at the smallest level over this and ends at the largest detectable level."""
HALVINGS = 4
"""Halvings of the logarithmic range of the search."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """One cell of the table."""

    effect: str
    real: str
    rig: str
    protocol: str
    channels: tuple[str, ...] = ("position",)
    draws: int = 4
    seed: int = 0


def smallest(search: Search, simulate: Simulate, engines: Sequence[str]) -> dict:
    """A row with the smallest detectable magnitude in its unit; `engines` are all engines.

    `bound` is '>' if no level is detectable, '<' if the smallest tried one is. The search ends at
    the largest detectable level, because the steps of a sensor may be too coarse to show anything.
    """
    kind = catalogue()[search.effect]
    least, *levels = _sizes(search, kind)
    cases = _cases(search)
    shows = partial(_shows, search, cases, simulate=simulate, engines=engines)
    shown = next((size for size in reversed(levels) if shows(size)), None)
    low, high = (least, shown) if shown is not None else (levels[-1], levels[-1])
    for _ in range(HALVINGS if shown is not None else 0):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if shows(middle) else (middle, high)
    bound = ">" if shown is None else "<" if low == least else ""
    return asdict(search) | {
        "channels": "+".join(search.channels),
        "smallest": high / UNITS[kind.unit][1],
        "unit": kind.unit,
        "bound": bound,
    }


def _sizes(search: Search, kind: type[Effect]) -> tuple[float, ...]:
    """Start of the search, and the levels at which it may end, all positive, SI."""
    scale = kind.natural(rigs.nominal(search.rig).drives[0])
    return tuple(scale * abs(level) for level in (kind.levels[0] / BELOW, *kind.levels))


def _cases(search: Search) -> tuple[Case, ...]:
    """Cases without an effect: nominal errors alone."""
    settings = draw.Settings(
        cases=search.draws,
        reals=(search.real,),
        rigs=(search.rig,),
        modes=("none",),
        protocols=(search.protocol,),
        channels=(search.channels,),
    )
    return draw.draw(settings, search.seed)


def _shows(
    search: Search, cases: Sequence[Case], size: float, simulate: Simulate, engines: Sequence[str]
) -> bool:
    """Whether a magnitude is detectable in at least half of the draws."""
    hits, misses = 0, 0
    while 2 * hits < len(cases) and 2 * misses <= len(cases):
        bare = cases[hits + misses]
        case = _with(bare, search, size, catalogue()[search.effect])
        if catalogue()[search.effect].shows_in_hand():
            grasps = Grasps(case=case, simulate=simulate, seed=search.seed)
            found = grasps.apart_nats(case.faults[0], engines) >= DETECTABLE_NATS
        else:
            rng = np.random.default_rng([search.seed, 3, bare.number])
            found = _seen(case, real_log(case, simulate, rng))
        hits, misses = hits + found, misses + (not found)
    return 2 * hits >= len(cases)


def _seen(case: Case, log: Log) -> bool:
    """Whether a case's one effect is detectable."""
    name = case.faults[0].effect
    if catalogue()[name].least is not None:
        return detectable(case, log)
    try:
        return diagnose(log, nominal=rigs.nominal(case.rig)).verdict == (name,)
    except LogError:
        return False


def _with(bare: Case, search: Search, size: float, kind: type[Effect]) -> Case:
    """The case with the effect on the first joint that it concerns, and without other errors."""
    spec = rigs.nominal(search.rig)
    joints = kind(magnitude=0.0).joints(spec)
    fault = Fault(
        effect=search.effect,
        joint=joints[0] if joints else None,
        magnitude=float(np.copysign(size, kind.levels[0])),
    )
    kept = (e for e in bare.nominal if (e.effect, e.joint) != (fault.effect, fault.joint))
    return replace(bare, mode="single", faults=(fault,), nominal=tuple(kept))


def table(rows: Sequence[dict]) -> pd.DataFrame:
    """The cells as a table: a row per effect, a column per real side and protocol."""
    cells = pd.DataFrame(rows)
    cells["said"] = [
        f"{'> ' * (r.bound == '>')}{'< ' * (r.bound == '<')}{r.smallest:.2g}"
        for r in cells.itertuples()
    ]
    cells["column"] = [
        ", ".join([r.real, r.protocol, *(set(SKIN) & set(r.channels.split("+")))])
        for r in cells.itertuples()
    ]
    wide = cells.pivot(index=["rig", "effect", "unit"], columns="column", values="said")
    wide = wide.reindex(columns=list(dict.fromkeys(cells["column"]))).fillna("")
    wide.columns.name = None
    return wide.reset_index()


def write(rows: Sequence[dict], folder: Path) -> list[Path]:
    """Write detectable.csv, a row per cell, and detectable.md, the table."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / "detectable.csv", folder / "detectable.md"]
    pd.DataFrame(rows).to_csv(files[0], index=False)
    files[1].write_text(markdown(table(rows)) + "\n")
    return files
