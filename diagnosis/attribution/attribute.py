"""Which effect: every candidate is tried, the best are refitted, and held-out samples judge.

A verdict for one limb: effects with their joints and magnitudes, `none` where nominal parameters
within their uncertainty explain the log, or `unknown` where no catalogued effect does.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.candidates import Candidate, candidates, nuisances
from diagnosis.attribution.evidence import Evidence
from diagnosis.attribution.fit import Fit, Fitter, Profile

REFINED, FINALISTS = 10, 5
"""Candidates whose magnitude is searched, and those that are refitted with everything free."""
STRAINED = 1.5
"""Nats per nominal parameter beyond which their refit is bent to explain something else."""


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A candidate after its refit."""

    names: tuple[str, ...]
    """Names of its effects, in the order of `fit.effects`; none of the nominal world's."""
    fit: Fit
    judged: Array
    """Squared residuals on held-out samples, compressed, shape (n,)."""
    plain: Array
    """The same as they are."""
    unrest: float
    """See `Evidence.unrest`."""

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Joints of its effects; None: all that the effect concerns."""
        return tuple(effect.joint for effect in self.fit.effects)

    @property
    def gap(self) -> float:
        """Root mean square of the held-out residuals, compressed, in standard deviations."""
        return float(np.sqrt(self.judged.mean()))

    @property
    def strain(self) -> float:
        """Nats that the fitted nominal parameters cost."""
        return float(self.fit.deviations @ self.fit.deviations / 2)


class Attribution:
    """The search for causes in one limb's evidence."""

    def __init__(
        self, evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
    ) -> None:
        self.fitter = Fitter(evidence, nuisances(evidence.nominal, uncertainty))
        self._candidates = candidates(catalogue, evidence)
        zeros = np.zeros(len(self.fitter.nuisances))
        self.before = self._ranked((), Fit(effects=(), deviations=zeros, cost=0.0))
        self.nominal = self._ranked((), self.fitter.nominal())
        plausible = self.nominal.strain < STRAINED * len(zeros)
        self.singles = self._rank(self.nominal if plausible else self.before)
        self.nominal = self._settled()

    def _settled(self) -> Ranked:
        """The nominal refit, again from where the best single effect has taken the parameters.

        A refit that stopped early would make any effect look needed.
        """
        best = min(self.singles, key=lambda one: one.fit.cost)
        deviations = best.fit.deviations
        start = Fit(effects=(), deviations=deviations, cost=self.fitter.cost((), deviations))
        again = self.fitter.refit(start)
        better = again.cost < self.nominal.fit.cost
        return self._ranked((), again) if better else self.nominal

    def second(self, first: Ranked) -> list[Ranked]:
        """The best pairs that hold `first`."""
        return self._rank(first, refined=6, finalists=2)

    def _rank(
        self, base: Ranked, refined: int = REFINED, finalists: int = FINALISTS
    ) -> list[Ranked]:
        around = base.fit
        profile = Profile(self.fitter, around)
        fresh = [c for c in self._candidates if not _there(c, around)]
        tried = [self._coarse(profile, around, c) for c in fresh]
        tried.sort(key=lambda pair: pair[1].cost)
        last = len(around.effects)
        searched = [(c, profile.search(fit, last, 3.0)) for c, fit in tried[:refined]]
        searched.sort(key=lambda pair: pair[1].cost)
        found = [
            self._ranked((*base.names, c.name), self.fitter.refit(self._true(around, fit)))
            for c, fit in searched[:finalists]
        ]
        return sorted(found, key=lambda one: one.judged.mean())

    def _coarse(self, profile: Profile, around: Fit, candidate: Candidate) -> tuple[Candidate, Fit]:
        tries = (
            profile.at(
                Fit(
                    effects=(
                        *around.effects,
                        candidate.kind(magnitude=m, joint=candidate.joint),
                    ),
                    deviations=around.deviations,
                    cost=np.inf,
                )
            )
            for m in candidate.levels
        )
        return candidate, min(tries, key=lambda fit: fit.cost)

    def _true(self, around: Fit, guess: Fit) -> Fit:
        """A linear guess with its real cost, or its effects alone where these do better."""
        free = self.fitter.free(guess.effects)
        tries = (
            Fit(effects=guess.effects, deviations=d, cost=self.fitter.cost(guess.effects, d))
            for d in (guess.deviations, around.deviations * free, 0.0 * around.deviations)
        )
        return min(tries, key=lambda fit: fit.cost)

    def _ranked(self, names: tuple[str, ...], fit: Fit) -> Ranked:
        judged, plain = (
            self.fitter.residual(fit.effects, fit.deviations, True, compress) ** 2
            for compress in (True, False)
        )
        unrest = self.fitter.unrest(fit)
        return Ranked(names=names, fit=fit, judged=judged, plain=plain, unrest=unrest)


def _there(candidate: Candidate, fit: Fit) -> bool:
    """Whether a fit has the candidate's effect on the same joints, or on some of them."""
    same = [e.joint for e in fit.effects if type(e) is candidate.kind]
    return any(joint == candidate.joint or None in (joint, candidate.joint) for joint in same)
