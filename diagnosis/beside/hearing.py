"""Lost packets of a limb, and the world that explains best what it did with the others.

A world that is fitted to all commands adapts to make up for those that did not arrive, and in such
a world few losses show. So packets are decoded and the world is refitted to those that arrived, in
turn, as segmental k-means does (Juang and Rabiner, IEEE Trans. Acoustics, Speech and Signal
Processing 38, 1990).
"""

from collections.abc import Sequence
from dataclasses import dataclass

from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Fitter
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.whiten import surprise
from diagnosis.beside.packets import (
    Path,
    Scale,
    arrived,
    code,
    counts,
    decoded,
    even,
    scale_of,
    share_lost,
)

FIRST_SHARE, ROUNDS = 0.1, 5
"""Share of lost packets that the first decoding assumes, and decodings."""
REFIT = (1.0, 1.0)
"""Rounds of each refit, see `fit.POLISH`."""
ENOUGH = 3.0
"""Rounds end when one lowers the cost of the fit by less [nats]."""


@dataclass(frozen=True, kw_only=True)
class Heard:
    """One explanation of a limb's evidence by packets that were lost."""

    path: Path
    scale: Scale
    evidence: Evidence
    """With the commands that arrived."""
    fitter: Fitter
    """On all samples of that."""
    fit: Fit
    nats: float
    """Cost of the fit, and of saying which packets were lost."""

    def surprise(self) -> float:
        """Whiteness z-score of held-out samples, of a fit to the others."""
        trained = Fitter(self.evidence, self.fitter.nuisances)
        fit = trained.refit(trained.at(self.fit.effects, self.fit.deviations))
        return surprise(trained.new(fit), self.evidence.tracks(True))


def hear(
    fitter: Fitter, starts: Sequence[Fit], lossy: tuple[str, ...], told_nats: float
) -> Heard | None:
    """The cheapest losses of joints' packets, from the worlds of several fits on.

    None where none are decoded, or none that cost less than the `told_nats` of no losses. A world
    that is off is first taken for one that lost too much.
    """
    found = [one for start in starts if (one := _heard(fitter, start, lossy, told_nats))]
    return min(found, key=lambda one: one.nats, default=None)


def _heard(fitter: Fitter, start: Fit, lossy: tuple[str, ...], told_nats: float) -> Heard | None:
    part, best, fit = fitter.evidence, None, start
    scale, lost_share = even(part), FIRST_SHARE
    for _ in range(ROUNDS):
        path = decoded(part, fitter.world(fit), lossy, scale, lost_share)
        if path.lossless:
            break
        scale = scale_of(part, path)
        lost_share = share_lost(part, path, scale)
        evidence = arrived(part, path)
        again = Fitter(evidence, fitter.nuisances, None)
        fit = again.refit(again.at(fit.effects, fit.deviations), REFIT)
        nats = fit.cost + code(*counts(part, path))
        if best is not None and (nats > told_nats or fit.cost > best.fit.cost - ENOUGH):
            break
        if nats <= told_nats:
            best = Heard(
                path=path, scale=scale, evidence=evidence, fitter=again, fit=fit, nats=nats
            )
    return best
