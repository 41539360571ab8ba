"""From a part of a long log to all of it: what a search found, fitted on."""

from diagnosis.progress import Progress
from diagnosis.search.chaos import with_prediction_spread
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.search import Found, is_some, ranked
from diagnosis.verdict.ordinary import Ordinary

SINGLES = 3
"""So many single effects are fitted on."""
STEPS = 4
"""Steps of each such fit: it begins where the part's ended, with slopes from where the chosen set's
did."""


def on_whole(fitter: Fitter, found: Found, ordinary: Ordinary, progress: Progress) -> Found:
    """What was found on a part, on the log of `fitter`: of sets of one size, which leaves least."""
    fits = 2 + len(found.tied) + len(found.singles[:SINGLES])
    progress("how the whole log follows from each number", 0.0)
    slopes = fitter.fit(found.chosen.freed, found.chosen.u, steps=0).slopes
    known = dict[tuple[int, ...], Fit]()

    def again(fit: Fit) -> Fit:
        if fit.freed not in known:
            progress(f"fit {len(known) + 1} of {fits} to the whole log", len(known) / fits)
            more = fitter.fit(fit.freed, fit.u, slopes=slopes, steps=STEPS, again=False)
            known[fit.freed] = more if fit.freed else fitter.strained(more, ordinary)
        return known[fit.freed]

    nominal, first, *tied = map(again, (found.nominal, found.chosen, *found.tied))
    singles = sorted(map(again, found.singles[:SINGLES]), key=lambda fit: fit.excess)
    alike = [fit for fit in (first, *tied, *singles) if len(fit.freed) == len(first.freed)]
    some = [fit for fit in alike if is_some(fitter.parameters, fit)]
    best = next(iter(ranked(fitter, some)), nominal)
    return Found(
        nominal=nominal,
        chosen=with_prediction_spread(fitter, best, ordinary),
        singles=tuple(singles),
        tied=tuple(fit for fit in (first, *tied) if fit.freed != best.freed),
        is_likely=found.is_likely and best is first,
    )
