"""From a part of a long log to all of it: what a search found, fitted on."""

from diagnosis.search.chaos import with_prediction_spread
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.search import Found
from diagnosis.verdict.ordinary import Ordinary

SINGLES = 3
"""So many single effects are fitted on."""
STEPS = 4
"""Steps of each such fit: it begins where the part's ended."""


def on_whole(fitter: Fitter, found: Found, ordinary: Ordinary) -> Found:
    """What was found on a part, on the log of `fitter`."""
    nominal = fitter.settled(near=found.nominal.u)
    known = {found.nominal.freed: nominal}

    def again(fit: Fit) -> Fit:
        if fit.freed not in known:
            on = fitter.fit(fit.freed, near=fit.u, slopes=nominal.slopes, steps=STEPS)
            known[fit.freed] = on
        return known[fit.freed]

    chosen = again(found.chosen)
    if any(abs(chosen.u[k]) < fitter.parameters[k].least for k in chosen.freed):
        chosen = nominal
    if chosen.freed and chosen.worst > ordinary.floors:
        chosen = with_prediction_spread(fitter, chosen)
    return Found(
        nominal=nominal,
        chosen=chosen,
        singles=tuple(sorted(map(again, found.singles[:SINGLES]), key=lambda f: f.excess)),
        tied=tuple(map(again, found.tied)),
        is_likely=found.is_likely,
    )
