"""Where healthy logs of a robot have its numbers, and what its drives do that no file says."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from diagnosis.evidence.evidence import Evidence
from diagnosis.models.loops import is_term
from diagnosis.models.parameters import Parameter
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.search import QUIET, Search
from diagnosis.verdict.ordinary import SHARE, Ordinary

WIDE = 3.0
"""A healthy robot may be so many times further from its file, where its logs say so."""
NARROW = 0.5
"""Around where healthy logs have it, a tolerance of either sign is so much narrower, and a guess
as wide as numbers that are known."""
TERM = 0.1
"""Standard deviation of a term of drives, relative to what healthy logs have of it."""


def healthy_fit(said: Evidence, known: Sequence[Parameter], ordinary: Ordinary) -> Fit:
    """A fit of the tolerances to a healthy log, and of a term of the drives that closes its gap."""
    fit = Fitter(said, known).settled()
    if fit.worst < QUIET:
        return fit
    wide = [replace(one, tolerance=WIDE * one.tolerance) for one in known]
    fit = Fitter(said, wide).settled(fit.u)
    if fit.worst <= ordinary.floors:
        return fit
    terms = [replace(one, nameable=one.nameable and is_term(one)) for one in known]
    found = Search(Fitter(said, terms), ordinary, lambda text, share: None).run()
    return found.chosen if found.share(found.chosen) >= SHARE else fit


def centred(
    known: Sequence[Parameter], sound: Sequence[Fit], uncertainty: float
) -> tuple[Parameter, ...]:
    """Parameters around where healthy logs have them; `uncertainty` of numbers that are known.

    A term of drives that all of them have is no candidate any more, but a tolerance.
    """
    found = []
    for k, one in enumerate(known):
        centre = float(np.mean([fit.u.get(k, 0.0) for fit in sound]))
        if one.tolerance > 0.0:
            narrow = one.tolerance * (NARROW if one.kind.either_sign else 1.0)
            if one.kind.coordinate == "logarithm" and one.kind.least is not None:
                sd = max(fit.sd.get(k, one.tolerance) for fit in sound)
                narrow = min(narrow, float(np.hypot(sd, uncertainty)))
                one = replace(one, least=max(one.kind.least, 2.0 * narrow))
            one = replace(one, centre=centre, tolerance=narrow)
        elif is_term(one) and all(k in fit.freed for fit in sound):
            one = replace(one, centre=centre, tolerance=TERM * centre, nameable=False)
        found.append(one)
    return tuple(found)
