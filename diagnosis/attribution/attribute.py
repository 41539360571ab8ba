"""Which effect: every candidate is tried, the best are refitted, and held-out samples judge.

A verdict for one limb: effects with their joints and magnitudes, `none` where nominal parameters
within their uncertainty explain the log, or `unknown` where no catalogued effect does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.state import Array
from diagnosis.attribution.candidates import Candidate, candidates, nuisances
from diagnosis.attribution.evidence import Evidence, compressed
from diagnosis.attribution.fit import CALM, POLISH, Fitter
from diagnosis.attribution.leftover import Leftover
from diagnosis.attribution.profile import Fit
from diagnosis.attribution.refits import CLOSE, NEAR_NATS, Refits
from diagnosis.attribution.rules import rules
from diagnosis.attribution.screening import coarse, everywhere, there, various, with_everywhere
from diagnosis.attribution.simplex import simplex
from diagnosis.attribution.timing import AngleLate
from diagnosis.attribution.whiten import alike, surprise

REFINED, FINALISTS = 10, 5
"""Candidates whose magnitude is searched, and those that are refitted with everything free."""
PARTNERS, COUPLES = 8, 3
"""The same of second effects."""
PROMISE = 0.25
"""Share of what an effect must promise that it does already at the best of a few magnitudes."""
HOLLOW = 60.0
"""Slopes promise no more than this, unless there is something [nats]."""
REAL = 2
"""Candidates beside these that really fit best, where linear costs are no guide."""
STRAINED = 1.0
"""Nats per nominal parameter beyond which their refit makes up for something else."""
HOPELESS = 0.05
"""Finalists that are behind the best by more than this share of the cost are fitted no further."""
SEEN = 0.7
"""A search without slopes is worth its while for what leaves no more than this of a gap."""
DELAYED = 2.0
"""Standard deviations that readings are late from which a delay is suspected."""
LAST = (1.0,)
"""Rounds of the refit to all samples, see `fit.POLISH`."""


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A candidate after its refit."""

    names: tuple[str, ...]
    """Names of its effects, in the order of `fit.effects`; none of the nominal world's."""
    fit: Fit
    """Fitted to all samples."""
    plain: Array
    """Squared residuals on held-out samples, of the fit to the others, shape (n,)."""
    surprise: float
    """Whiteness z-score of the innovations, see `whiten`."""
    spread: float
    """Variance of block means of these over that of white ones, see `whiten.alike`."""
    unrest: float
    """How chaotic the replay is, see `Evidence`."""

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Joints of its effects; None: all that the effect concerns."""
        return tuple(effect.joint for effect in self.fit.effects)

    @property
    def gap(self) -> float:
        """Root mean square of the held-out residuals, compressed, in standard deviations."""
        return float(np.sqrt((compressed(np.sqrt(self.plain)) ** 2).mean()))

    @property
    def bent(self) -> float:
        """How far the nominal parameter that is farthest off is, in its standard deviations."""
        return float(np.abs(self.fit.deviations).max(initial=0.0))


class Attribution:
    """The search for causes in one limb's evidence."""

    def __init__(
        self, evidence: Evidence, catalogue: Mapping[str, type[Effect]], uncertainty: float
    ) -> None:
        known = nuisances(evidence.nominal, uncertainty)
        self.fitter = Fitter(evidence, known)
        self.rule = evidence.sound.excused(rules()) if evidence.sound else rules()
        """What the verdict goes by."""
        self._refits = Refits(self.fitter, self.rule.bent_stds)
        self.whole = self._refits.whole
        self._candidates = candidates(catalogue, evidence)
        self._leftovers: dict[int, Leftover] = {}
        bare = self.fitter.at((), np.zeros(len(known)))
        self.before = self._judged((), bare, bare)
        found = self.fitter.nominal()
        strained = found.deviations @ found.deviations / 2 >= 1.5 * STRAINED * len(known)
        self._base, self._moved = bare if strained else found, found.deviations
        self.pairs: list[Ranked] = []
        """All that were tried."""
        self.singles: list[Ranked] = []
        self.singles = self._rank((), self._base)
        self.nominal = self._settled(found)
        self.singles[:1] = [self.slopeless(one) for one in self.singles[:1]]

    def slopeless(self, one: Ranked, settled: float = 1.0) -> Ranked:
        """A candidate; searched without slopes where it is chaotic and leaves more than that.

        Where it leaves nearly all that there is, it is no dip near by that it has missed.
        """
        hopeless = one.gap > SEEN * self.nominal.gap
        if one.unrest <= CALM or one.gap <= settled or hopeless:
            return one
        trained = simplex(self.fitter, self._trained(one.fit))
        whole = simplex(self.whole, self.whole.at(trained.effects, trained.deviations))
        again = self._judged(one.names, trained, whole)
        return min(one, again, key=lambda ranked: ranked.fit.cost)

    def elsewhere(self, one: Ranked) -> Ranked:
        """A candidate, or it from other magnitudes where that fits better."""
        levels = {(c.name, c.joint): c.levels for c in self._candidates}
        sizes = [levels[effect] for effect in zip(one.names, one.joints, strict=True)]
        again = self._ranked(one.names, self._refits.elsewhere(one.fit, sizes), CLOSE)
        if again.fit.cost >= one.fit.cost:
            return one
        tried = self.singles if len(one.names) == 1 else self.pairs
        tried[:] = sorted([again, *(o for o in tried if o is not one)], key=lambda o: o.fit.cost)
        return again

    def _settled(self, found: Fit) -> Ranked:
        """The nominal refit, again from where the best single effect has taken the parameters.

        A refit that stopped early would make any effect look needed.
        """
        start = self.fitter.at((), self.singles[0].fit.deviations) if self.singles else found
        again = self.fitter.refit(start) if start.cost < 2 * found.cost else found
        best = min((found, again), key=lambda fit: fit.cost)
        return self._closed([self._ranked((), best)])[0]

    def second(
        self, first: Ranked, worth_nats: float = 0.0, explained: bool = False
    ) -> list[Ranked]:
        """The best pairs that hold `first`; of those that promise to lower the cost by so much.

        Where the first explains the log, they must do a part of it at once, or promise more than
        the tens of nats that slopes promise and nothing holds.
        """
        around = self._trained(first.fit)
        asked = PARTNERS, COUPLES, worth_nats, explained
        return self._noted(self._rank(first.names, around, *asked))

    def exchanged(self, pair: Ranked) -> list[Ranked]:
        """The best pairs that hold the later one of a pair: the first may have been a stand-in."""
        alone = self.fitter.at(pair.fit.effects[1:], pair.fit.deviations)
        around = self.fitter.refit(alone)
        return self._noted(self._rank(pair.names[1:], around, PARTNERS, COUPLES))

    def instead(self, pair: Ranked, anything: bool = False) -> list[Ranked]:
        """Pairs with a parameter beyond its prior limit in place of either effect.

        Or with anything. The other one may have been its stand-in.
        """
        suspects = self._suspects(pair.fit.deviations, self._candidates)
        among = self._candidates if anything else suspects
        found: list[Ranked] = []
        for name, effect in zip(pair.names, pair.fit.effects, strict=True):
            around = self.fitter.at((effect,), pair.fit.deviations)
            found += self._rank((name,), around, PARTNERS, COUPLES, among=among)
        return self._noted(found)

    def again(self, one: Ranked) -> Ranked:
        """A candidate from other dips around its fit, see `Refits.again`."""
        found = self._judged(one.names, *self._refits.again(one.fit))
        (self.pairs if len(one.names) > 1 else self.singles).append(found)
        return found

    def halves(self, pair: Ranked) -> list[Ranked]:
        """Both effects of a pair alone, from its nominal parameters."""
        both = zip(pair.names, pair.fit.effects, strict=True)
        starts = [(name, self.fitter.at((effect,), pair.fit.deviations)) for name, effect in both]
        alone = [self._ranked((name,), self.fitter.refit(start)) for name, start in starts]
        again = self._refits
        return [replace(o, fit=again.believed(again.shaken(o.fit), o.spread)) for o in alone]

    def leftover(self, one: Ranked) -> Leftover:
        """What a candidate leaves; kept, for it is asked more than once."""
        return self._leftovers.setdefault(id(one.fit), Leftover(fitter=self.whole, fit=one.fit))

    def _noted(self, pairs: list[Ranked]) -> list[Ranked]:
        self.pairs += pairs
        return pairs

    def forgiving(self, one: Ranked) -> Evidence:
        """The evidence with residuals counted in the prediction spread of a candidate."""
        return self.whole.forgiving(one.fit)

    def _trained(self, fit: Fit) -> Fit:
        return self.fitter.at(fit.effects, fit.deviations)

    def _rank(
        self,
        names: tuple[str, ...],
        around: Fit,
        refined: int = REFINED,
        finalists: int = FINALISTS,
        worth_nats: float = -np.inf,
        at_once: bool = False,
        among: Sequence[Candidate] | None = None,
    ) -> list[Ranked]:
        """Candidates beside the effects of a fit, the best first."""
        profile, last = self.fitter.profile(around), len(around.effects)
        asked = self._candidates if among is None else among
        fresh = [c for c in asked if not there(c, around)]
        fresh = [self._with_moved(c, around) for c in fresh]
        suspects = self._suspects(around.deviations if around.effects else self._moved, fresh)
        tried = sorted(coarse(profile, around, fresh), key=lambda pair: pair[1].cost)
        if at_once:
            without = profile.at(around.effects)
            least = self._refits.true(around, without).cost - PROMISE * worth_nats
            tried = [
                (c, fit)
                for c, fit in tried
                if any(c is one for one in suspects)
                or without.cost - fit.cost >= HOLLOW
                or self._refits.true(around, fit).cost <= least
            ]
        chosen = self._with_real(around, tried, with_everywhere(tried, refined))
        searched = [
            (c, profile.search((*around.effects, fit.effects[-1]), last, 3.0))
            for c, fit in _with(suspects, tried, chosen)
        ]
        searched.sort(key=lambda pair: pair[1].cost)
        worth = [(c, fit) for c, fit in searched if around.cost - fit.cost >= worth_nats]
        chosen = self._with_real(around, worth, various(worth, finalists))
        best = self._with_delay(around, fresh, _with(suspects, searched, chosen))
        fits = [self.fitter.refit(self._refits.true(around, fit), POLISH[:2]) for _, fit in best]
        hard = all(map(self._refits.is_hard, fits))
        fits = [
            self._refits.anew(f, tried) if hard or c in suspects else f
            for f, (c, tried) in zip(fits, best, strict=True)
        ]
        near = min(fit.cost for fit in fits) + HOPELESS * around.cost if fits else 0.0
        fits = [self.fitter.refit(f, POLISH[2:]) if f.cost < near else f for f in fits]
        fits = [self._refits.unbent(f) if f.cost == min(g.cost for g in fits) else f for f in fits]
        found = [
            self._ranked((*names, c.name), f, LAST if f.cost < near else ())
            for (c, _), f in zip(best, fits, strict=True)
        ]
        return self._closed(sorted(found, key=lambda one: one.fit.cost))

    def _with_real(
        self,
        around: Fit,
        tried: Sequence[tuple[Candidate, Fit]],
        chosen: Sequence[tuple[Candidate, Fit]],
    ) -> list[tuple[Candidate, Fit]]:
        """What was chosen by linear costs, and where these are small what really fits best.

        Slopes that are wrong by some tens of nats do no harm among thousands, and hide an effect
        that is hardly larger than the uncertainty of nominal parameters.
        """
        if self._refits.is_hard(around):
            return list(chosen)
        kept = {id(c) for c, _ in chosen}
        others = [(c, fit) for c, fit in tried if id(c) not in kept]
        costs = [self.fitter.cost(fit.effects, fit.deviations) for _, fit in others]
        return [*chosen, *(others[k] for k in np.argsort(costs)[:REAL])]

    def _suspects(self, deviations: Array, among: Sequence[Candidate]) -> list[Candidate]:
        """The effect that is the nominal parameter most bent beyond belief, there and on all.

        A prior holds these back, and what they would do as effects is more than slopes foretell. A
        nominal refit that is much bent is not what is searched around, yet what it bends counts.
        """
        pairs = zip(self.fitter.nuisances, deviations, strict=True)
        bent = {(n.kind, n.joint): abs(d) for n, d in pairs}
        found = [(bent.get((c.kind, c.joint), 0.0), c) for c in among]
        most, suspect = max(found, key=lambda one: one[0], default=(0.0, None))
        if suspect is None or most <= self.rule.alone_stds:
            return []
        return [c for c in among if c is suspect or everywhere(c, suspect.name)]

    def _with_delay(
        self, around: Fit, fresh: Sequence[Candidate], chosen: Sequence[tuple[Candidate, Fit]]
    ) -> list[tuple[Candidate, Fit]]:
        """What was chosen, and the best delay as large as what late readings have taken of one.

        Other parameters have bent to take the rest, so it pays only once they give way.
        """
        late, in_time = self._refits.lateness(around)
        if late < DELAYED * max(n.std for n in self.fitter.nuisances if n.kind is AngleLate):
            return list(chosen)
        delays = [
            (c, self.fitter.at((*around.effects, effect), in_time.deviations))
            for c in fresh
            if c.kind.dimension == "time" and all(c is not other for other, _ in chosen)
            for effect in (c.kind(magnitude=late, joint=c.joint),)
        ]
        return [*chosen, *sorted(delays, key=lambda pair: pair[1].cost)[:1]]

    def _closed(self, found: list[Ranked]) -> list[Ranked]:
        """Candidates with those that are near the best one refitted until nothing changes."""
        near = found[0].fit.cost + NEAR_NATS if found else 0.0
        again: list[Ranked] = []
        for one in found:
            fit = self.whole.refit(one.fit, CLOSE) if one.fit.cost < near else one.fit
            if again and one.fit.cost < near:
                fit = min(fit, self._refits.beside(fit, again[0].fit), key=lambda f: f.cost)
            if one is found[0]:
                fit = self._refits.leapt(fit)
            if one.names and one.fit.cost < near:
                fit = self._refits.believed(fit, one.spread)
            again.append(replace(one, fit=fit))
        again.sort(key=lambda one: one.fit.cost)
        again[:0] = self._wider(again)
        return again

    def _wider(self, found: Sequence[Ranked]) -> list[Ranked]:
        """The effect of the best candidate on all joints, where that fits better than on one.

        Asked where the one leaves something to explain: to slopes around a world that lacks the
        effect on both, an effect on each looks as good.
        """
        best = found[0] if found else None
        if best is None or not best.names or best.surprise <= self.rule.white_sd:
            return []
        name, last = best.names[-1], best.fit.effects[-1]
        known = any(one.names == best.names and one.joints[-1] is None for one in found)
        if known or not any(everywhere(c, name) for c in self._candidates):
            return []
        effects = (*best.fit.effects[:-1], replace(last, joint=None))
        fit = self.fitter.refit(self.fitter.at(effects, best.fit.deviations))
        wide = self._ranked(best.names, fit, CLOSE)
        return [wide] if wide.fit.cost < best.fit.cost else []

    def _with_moved(self, candidate: Candidate, around: Fit) -> Candidate:
        """A candidate, also as large as it is alone, and as fits have moved what it changes."""
        pairs = zip(self.fitter.nuisances, around.deviations, self._moved, strict=True)
        moved = [
            float(d * n.std)
            for n, *fitted in pairs
            if issubclass(candidate.kind, n.kind) and candidate.joint in (None, n.joint)
            for d in set(fitted) - {0.0}
        ]
        low, high = candidate.kind.bounds
        inside = [m for m in moved if low <= m <= high and m != 0.0]
        alone = [
            one.fit.effects[0].magnitude
            for one in self.singles
            if (one.names, one.joints) == ((candidate.name,), (candidate.joint,))
        ]
        return replace(candidate, levels=(*candidate.levels, *inside, *alone))

    def _ranked(
        self, names: tuple[str, ...], trained: Fit, rounds: Sequence[float] = LAST
    ) -> Ranked:
        """A fit judged on held-out samples, and then fitted to all."""
        start = self.whole.at(trained.effects, trained.deviations)
        return self._judged(names, trained, self.whole.refit(start, rounds))

    def _judged(self, names: tuple[str, ...], trained: Fit, whole: Fit) -> Ranked:
        new = self.fitter.new(trained)
        return Ranked(
            names=names,
            fit=whole,
            plain=self.fitter.left(trained),
            surprise=surprise(new, self.fitter.evidence.tracks(True)),
            spread=alike(new),
            unrest=self.fitter.unrest(trained),
        )


def _with(
    suspects: Sequence[Candidate],
    tried: Sequence[tuple[Candidate, Fit]],
    chosen: Sequence[tuple[Candidate, Fit]],
) -> list[tuple[Candidate, Fit]]:
    """What was chosen, and the suspects."""
    kept = {id(c) for c, _ in chosen}
    wanted = [(c, fit) for c, fit in tried if any(c is one for one in suspects)]
    return [*chosen, *(pair for pair in wanted if id(pair[0]) not in kept)]
