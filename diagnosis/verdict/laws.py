"""Where no effect explains a gap: what the drive's loop may do that log.yaml does not say.

An integral, a filter, a lag, a gain on the speed's error: each is fitted beside the tolerances. It
names no cause, for it is no fault; it says what to look up.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from backends.effect import NumberEffect
from diagnosis.models.parameters import Parameter
from diagnosis.motion.columns import COLUMNS, INTEGRAL, KP, LIMIT
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.search import Found
from diagnosis.verdict.ordinary import Ordinary
from diagnosis.verdict.result import UNKNOWN, LimbResult

CLOSES = 0.95
"""A law is said that closes so much of the excess, or leaves an ordinary gap."""


class _Number(NamedTuple):
    """A number of a loop, by its name in log.yaml; in multiples of the column `times`."""

    name: str
    column: str
    start: float
    most: float
    times: int | None = None


TERMS = {
    "an integral": (
        _Number("ki", "loop.integral_hz", 1.0, 50.0, KP),
        _Number("integral_limit", "loop.integral_limit_nm", 0.25, 1.0, LIMIT),
    ),
    "an integral on its speed, as in a cascade,": (
        _Number("speed_integral", "loop.speed_integral_hz", 1.0, 200.0),
        _Number("integral_limit", "loop.integral_limit_nm", 0.25, 1.0, LIMIT),
    ),
    "a filter on its speed": (_Number("filter", "loop.filter_s", 0.01, 0.2),),
    "a torque that lags": (_Number("lag", "loop.lag_s", 0.005, 0.2),),
    "kd on the error of the speed": (_Number("lead", "loop.lead", 0.5, 1.0),),
}
"""What a loop may do, and its numbers."""


def with_law(result: LimbResult, fitter: Fitter, found: Found, ordinary: Ordinary) -> LimbResult:
    """The result, of which an unknown gap says what its drives may do; only of rigid drives."""
    limb = fitter.evidence.limb
    if result.verdict != (UNKNOWN,) or not limb.rigid or limb.open.any():
        return result
    tried = sorted(_tried(fitter, found), key=lambda one: one[0].excess)
    for fit, law in tried[:1]:
        closes = fit.excess <= (1.0 - CLOSES) * found.nominal.excess
        if closes or fit.worst <= ordinary.floors:
            return replace(result, law=law, leading=())
    return result


def _tried(fitter: Fitter, found: Found) -> Iterator[tuple[Fit, str]]:
    """Each term on the joint with the largest gap: its fit, and what to say."""
    limb, known = fitter.evidence.limb, fitter.parameters
    j = int(np.argmax(found.nominal.gap2))
    for words, numbers in TERMS.items():
        places = [COLUMNS.index(one.column) for one in numbers]
        if limb.nominal[j, places[0]] > 0.0:
            continue
        sizes = [1.0 if one.times is None else limb.nominal[j, one.times] for one in numbers]
        free = [
            Parameter(
                effect=one.name,
                kind=NumberEffect,
                joint=j,
                place=place,
                unit=1.0 if place == INTEGRAL else size,
                tolerance=0.0,
                least=0.1 * one.start,
                most=one.most,
            )
            for one, place, size in zip(numbers, places, sizes, strict=True)
        ]
        more = Fitter(fitter.evidence, (*known, *free))
        more.usual = fitter.usual
        own = range(len(known), len(more.parameters))
        start = {k: one.start for k, one in zip(own, numbers, strict=True)}
        fit = more.fit(tuple(own), start, slopes=found.nominal.slopes)
        fit = more.fit(tuple(own), fit.u, slopes=fit.slopes)
        triples = zip(numbers, own, sizes, strict=True)
        said = ", ".join(f"{one.name}: {fit.u[k] * size:.3g}" for one, k, size in triples)
        yield (
            fit,
            f"With {words} in the drive of {limb.joints[j]} (`{said}`), {fit.gap:.1f} floors "
            "would be left: if it has that, write it in log.yaml.",
        )
