"""One candidate's fit, and better ones from other starts: a refit ends in the nearest dip."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.effect import Effect
from diagnosis.attribution.fit import ENOUGH, POLISH, Fitter
from diagnosis.attribution.profile import Fit, grown
from diagnosis.attribution.timing import AngleLate, Late, late_s

BELIEVED = 8.0
"""A fit without suspects is taken where it costs no more than this beside the best [nats]."""
HARD = 2.0
"""Mean square of innovations from which a search may have failed, and starts once more."""
HELPED = 0.9
"""A new start that leaves a larger share of the cost is the last one."""
NEAR_NATS = 30.0
"""So near the best, a candidate's fit has to be exact."""
LEAPS = (0.5, 2.0)
"""How many times as large a delay is tried beside what was found."""
SHAKES = (0.97, 1.03)
"""The same of an effect that a second one seems to be needed beside."""
HOPS, WIDER = 3, (0.85, 0.97, 1.03, 1.18)
"""How often at most a fit goes to a better dip, and how many times as large magnitudes it tries."""
STARTS = 3
"""Of other magnitudes so many are tried."""
CLOSE = (1.1, 1.0, 1.0)
"""Rounds of a refit near its end."""


class Refits:
    """New starts for fits to one limb's evidence: to the samples for fitting, and to all."""

    def __init__(self, fitter: Fitter, bent_stds: float) -> None:
        self.fitter = fitter
        """Fits to the samples for fitting."""
        evidence, known = fitter.evidence, fitter.nuisances
        self.whole = Fitter(evidence, known, None)
        """Fits to all samples."""
        self._within = Fitter(evidence, known, None, bent_stds)
        self._samples = len(evidence.tracks(False))

    def is_hard(self, fit: Fit) -> bool:
        """Whether a fit leaves so much that its search may have failed."""
        return fit.cost > HARD * self._samples / 2

    def anew(self, fit: Fit, tried: Fit) -> Fit:
        """A fit, or one from nominal parameters at their priors, if that is better."""
        start = self.fitter.at(tried.effects, 0.0 * tried.deviations)
        return min(fit, self.fitter.refit(start, POLISH[:2]), key=_cost)

    def again(self, fit: Fit) -> tuple[Fit, Fit]:
        """Fits of these effects to the samples for fitting, and to all, from dip to dip.

        From nominal parameters at their priors, and from magnitudes to either side. Where a joint
        sticks and slips, or plays, costs have many dips, and a delay makes some, too.
        """
        fitter, whole = self.fitter, self.whole
        trained = _hopping(fitter, fitter.at(fit.effects, fit.deviations))
        best = min((fit, whole.refit(whole.at(trained.effects, trained.deviations))), key=_cost)
        best = _hopping(whole, best)
        other = fitter.refit(fitter.at(best.effects, best.deviations))
        return min((trained, other), key=_cost), best

    def elsewhere(self, fit: Fit, sizes: Sequence[Sequence[float]]) -> Fit:
        """A fit, or a better one from other magnitudes and parameters at their priors.

        Of a law with thresholds costs have a dip for each event that a magnitude does not reach.
        """
        moved = [
            _with(fit.effects, k, replace(fit.effects[k], magnitude=size))
            for k, others in enumerate(sizes)
            for size in others
        ]
        starts = [self.fitter.at(es, 0.0 * fit.deviations) for es in (fit.effects, *moved)]
        near = sorted(starts, key=_cost)[:STARTS]
        fit = self.fitter.at(fit.effects, fit.deviations)
        return min([fit, *map(self.fitter.refit, near)], key=_cost)

    def unbent(self, fit: Fit) -> Fit:
        """A fit restarted from its magnitudes as long as that helps a lot, where it fits badly.

        While a magnitude is far off, nominal parameters bend to make up for it, and hold it there.
        """
        while self.is_hard(fit):
            again = self.fitter.refit(self.fitter.at(fit.effects, 0.0 * fit.deviations))
            if again.cost > HELPED * fit.cost:
                return min(fit, again, key=_cost)
            fit = again
        return fit

    def leapt(self, fit: Fit) -> Fit:
        """A fit, or a better one from where a delay in it is far larger or smaller.

        A delay acts on samples and periods: what it costs has kinks, at which a search ends. And
        the time of readings, which is nominal, may have taken a part of it. Where a fit leaves
        much, that is not its fault.
        """
        if fit.cost > HARD * self._samples:
            return fit
        late, in_time = self.lateness(fit)
        tries = [fit]
        for k, effect in enumerate(fit.effects):
            if effect.dimension == "time":
                tries += [self._from(fit, k, leap, CLOSE) for leap in LEAPS]
                whole = 1 + late / effect.magnitude
                tries += [self._from(in_time, k, whole, CLOSE)] if whole > 1 else []
        return min(tries, key=_cost)

    def shaken(self, fit: Fit) -> Fit:
        """A lone effect's fit, or a better one from magnitudes to either side.

        Where a joint sticks and slips, costs have many dips, and a pair searches more of them.
        """
        tries = [self._from(fit, 0, shake, POLISH) for shake in SHAKES]
        return min([fit, *tries], key=_cost)

    def believed(self, fit: Fit, spread: float) -> Fit:
        """A fit with no parameter beyond its prior limit, where the log does not insist on one.

        Of effects alone: a log that bends a parameter of the nominal world may have another cause.
        """
        most = self._within.farthest
        near = np.clip(fit.deviations, -most, most)
        if (near == fit.deviations).all():
            return fit
        held = self._within.refit(self._within.at(fit.effects, near), CLOSE)
        return held if held.cost <= fit.cost + BELIEVED * spread else fit

    def beside(self, fit: Fit, best: Fit) -> Fit:
        """A fit again from the nominal parameters of the best one, where that starts well."""
        start = self.whole.at(fit.effects, best.deviations)
        return self.whole.refit(start, CLOSE) if start.cost < fit.cost + 10 * NEAR_NATS else fit

    def true(self, around: Fit, guess: Fit) -> Fit:
        """A linear guess with its real cost, or its effects alone where these do better."""
        alone = (*around.effects, *guess.effects[len(around.effects) :])
        tries = (
            self.fitter.at(guess.effects, guess.deviations),
            self.fitter.at(alone, around.deviations),
            self.fitter.at(alone, 0.0 * around.deviations),
        )
        return min(tries, key=_cost)

    def lateness(self, fit: Fit) -> tuple[float, Fit]:
        """How late a fit reads positions [s], and the fit with readings that are in time."""
        nominal = [issubclass(n.kind, (Late, AngleLate)) for n in self.fitter.nuisances]
        in_time = replace(fit, deviations=np.where(nominal, 0.0, fit.deviations))
        return float(late_s(self.fitter.effects(fit))[0]), in_time

    def _from(self, fit: Fit, index: int, times: float, rounds: Sequence[float]) -> Fit:
        """A refit from where one of the effects is so many times as large."""
        effects = _grown(fit.effects, index, times)
        return self.whole.refit(self.whole.at(effects, fit.deviations), rounds)


def _hopping(fitter: Fitter, fit: Fit) -> Fit:
    """A fit, or a better one in a dip near by, as long as there is one.

    Each magnitude is shaken, with nominal parameters let go half way (Wales and Doye, J. Phys.
    Chem. A 101, 1997, hop so at random).
    """
    for _ in range(HOPS):
        starts = [(fit.effects, 0.0), (fit.effects, 0.5)]
        shaken = itertools.product(range(len(fit.effects)), WIDER)
        starts += [(_grown(fit.effects, index, times), 0.5) for index, times in shaken]
        tries = [fitter.refit(fitter.at(es, kept * fit.deviations)) for es, kept in starts]
        best = min(tries, key=_cost)
        if fit.cost - best.cost < ENOUGH:
            return min((fit, best), key=_cost)
        fit = best
    return fit


def _cost(fit: Fit) -> float:
    return fit.cost


def _grown(effects: tuple[Effect, ...], index: int, times: float) -> tuple[Effect, ...]:
    """Effects with one of them so many times as large."""
    return _with(effects, index, grown(effects[index], times))


def _with(effects: tuple[Effect, ...], index: int, effect: Effect) -> tuple[Effect, ...]:
    """Effects with another one in a place."""
    return (*effects[:index], effect, *effects[index + 1 :])
