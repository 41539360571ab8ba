"""The search of one limb: the smallest sets of effects that close its gap, driven by what is left.

From the fit of the tolerances alone, effects are added one at a time to the best few sets so far:
all are screened by one linear step, the best are fitted. What a set leaves decides (`excess`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice

import numpy as np
from scipy.optimize import minimize_scalar

from backends.effects.coulomb_friction import Effect as CoulombFriction
from backends.state import Array
from diagnosis.models.parameters import Parameter, with_parts
from diagnosis.motion.columns import COULOMB, MASS, PAYLOAD, SOFT, ZERO
from diagnosis.progress import Progress, Stop
from diagnosis.search.chaos import with_prediction_spread
from diagnosis.search.fit import Fit, Fitter, costs
from diagnosis.search.screening import Chords, screened
from diagnosis.verdict.exact import TIE_NATS, is_likely
from diagnosis.verdict.exact import ranked as ranked_by_nats
from diagnosis.verdict.ordinary import Ordinary, is_worth, share_of

MOST, BEAM, FITTED, POLISHED = 4, 3, 6, 2
"""At most so many causes, sought from so many of the best sets with one less; so many candidates of
each screening are fitted, and so many of the best sets then with the tolerances of all joints."""
REFINED = 2
"""So many of the best sets are fitted on at the end where they are tied."""
MIXED = 2
"""From so many causes on, only the best set is added to: the first two may have been mixed up."""
GUESSED = 1.0
"""Numbers whose logarithms have this standard deviation are guesses: they are fitted first, alone,
for others would move in their place."""
NOMINAL, ROUND = 0.3, 12
"""Share of the work that is done when the tolerances are fitted; so many sets halve the rest."""
FAR, MORE = 2.0, 3
"""Beyond so many ordinary gaps tolerances are far off, for they take what a fault does; so many
candidates beside the screening's."""
KIN = 6.0
"""Kin are fitted from so many of their least sizes, beside the scan."""
EACH = 2
"""At most so many causes on one joint."""
QUIET = 1.2
"""Nothing is sought where no joint's gap is larger [floors]."""
CONCERNED = 0.03
"""Effects are sought on joints with at least this share of the excess."""
PART = 0.05
"""The first of several causes takes at least this share of the gap."""
SHAPED = 0.3
"""Another effect of a cause's family gives its law more shape if it takes so much of the rest."""
OWN = 1.25
"""An effect that all joints share leaves so many times less [squared] than one on a joint alone;
so many times again for each size that it has."""
LOADS = MASS, PAYLOAD, ZERO
"""What shows on other joints as on its own."""
SENSOR = 1.5
"""A sensor's law is exact: it leaves so many times less [squared] than a mechanism's model."""
WIDER = 1.25
"""A law leaves so many times less [squared] than the one that it is in a narrow range."""
NEAR, NEAR_MORE = 4.0, 3.0
"""Sets are polished, and added to, whose excess is below so many times the best's, and this."""
TIE_SHARE, TIE, TIE_MORE = 0.05, 1.5, 1.0
"""Sets are tied whose share of the gap is less than this behind, and whose excess is below so many
times the best's, and this."""
END = 0.97
"""An effect is as large as is tried from this share of it on."""
DIVERGED = 1e12
"""What a motion that diverges leaves, as a number [squared floors]."""
SCANNED, FINE = 11, 1e-3
"""A kink is sought at so many sizes, then between the neighbours of the best to this share."""


Sizes = Mapping[int, float]
"""Of effects by number."""
Slopes = Mapping[int, Array]


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a search found."""

    nominal: Fit
    """The tolerances alone."""
    chosen: Fit
    """The smallest set that nothing more adds to; `nominal` where none is worth it."""
    singles: tuple[Fit, ...]
    """Every single effect that was fitted, the best first."""
    tied: tuple[Fit, ...]
    """Sets of the same size that this log cannot tell from the chosen one."""
    is_likely: bool
    """Whether the law is exact and the chosen set by far the likeliest."""
    stopped: bool = False
    """Whether the search was stopped before its end."""

    def share(self, fit: Fit) -> float:
        """The share of the excess that a set takes."""
        return share_of(fit, self.nominal)

    def lean(self) -> "Found":
        """The same without the slopes of sets that were not chosen, which take memory."""
        singles, tied = (
            tuple(replace(fit, slopes={}) for fit in some) for some in (self.singles, self.tied)
        )
        return replace(self, singles=singles, tied=tied)


class Search:
    """One limb's search."""

    def __init__(self, fitter: Fitter, ordinary: Ordinary, progress: Progress) -> None:
        self.fitter, self.ordinary, self.progress = fitter, ordinary, progress
        self.parameters: Sequence[Parameter] = fitter.parameters
        self.tried: dict[frozenset[int], Fit] = {}
        self.thinned: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
        self.chords: Chords = {}
        self.now: Fit | None = None
        self.singles: tuple[Fit, ...] = ()

    @cached_property
    def plain(self) -> Fit:
        """The nominal numbers as they stand, with the slopes of all tolerances there."""
        return self.fitter.fit(steps=0)

    @cached_property
    def guessed(self) -> list[int]:
        """Nominal numbers that are guesses."""
        wide = [k for k, p in enumerate(self.parameters) if p.tolerance >= GUESSED]
        return [k for k in wide if self.parameters[k].part_of is None]

    @cached_property
    def nominal(self) -> Fit:
        """The tolerances alone."""
        begun = self.plain
        if self.guessed:
            begun = self.fitter.fit(moving=self.guessed, slopes=begun.slopes)
        again = int(self.ordinary.exact)
        fit = self.fitter.settled(begun.u, again, begun.slopes)
        if self.soft and self.rubs:
            fit = self.fitter.better(fit, self.fitter.settled({**begun.u, **self.soft}, again))
        return self.fitter.strained(fit, self.ordinary)

    @cached_property
    def rubs(self) -> bool:
        """Whether the nominal world has dry friction."""
        return bool(self.fitter.evidence.limb.nominal[:, COULOMB].any())

    @cached_property
    def soft(self) -> Sizes:
        """Dry friction that yields, as that of a model's own simulator; a robot's holds."""
        return {k: 1.0 for k, one in enumerate(self.parameters) if one.place == SOFT}

    def run(self) -> Found:
        """From the tolerances to the smallest convincing set.

        Stopped, it gives the best of what it has tried; raises Stop where that is nothing.
        """
        try:
            self._seek()
        except Stop:
            if self.now is None:
                raise
            more = self._ranked(self._sets(len(self.now.freed) + 1))
            if more and self._is_worth(more[0], self.now):
                self.now = more[0]
            return replace(self._found(self.now), stopped=True)
        return self._found(self.now or self.nominal)

    def _seek(self) -> None:
        """Fit sets of ever more causes, until nothing more is worth it."""
        self.progress(
            f"fit of the nominal numbers of {', '.join(self.fitter.evidence.joints)}", 0.0
        )
        nominal = self.now = now = self.nominal
        beam = [nominal]
        for causes in range(1, MOST + 1):
            if now.worst < QUIET and not self.ordinary.exact:
                break
            for one in beam:
                self._add(one)
            fresh = self._polished(self._sets(causes))
            self.singles = self.singles or tuple(fresh)
            if not fresh or not self._is_worth(fresh[0], now):
                break
            self.now = now = with_prediction_spread(self.fitter, fresh[0], self.ordinary)
            width = BEAM if causes < MIXED else 1
            beam = _near(fresh[:width])

    def _found(self, now: Fit) -> Found:
        """The best of the sets tried, of as many causes as `now` has."""
        nominal, singles = self.nominal, self.singles
        if not singles:
            singles = tuple(self._ranked(self._sets(1)))
        if not now.freed:
            return Found(nominal=nominal, chosen=now, singles=singles, tied=(), is_likely=False)
        self._fit_alike(now)
        same = self._ranked(self._sets(len(now.freed)))
        if any(self._is_tied(fit, same[0]) for fit in same[1:REFINED]):
            for fit in same[:REFINED]:
                self._keep(self.fitter.fine(fit))
            same = self._ranked(self._sets(len(now.freed)))
        best, others = same[0], same[1 : BEAM + 1]
        return Found(
            nominal=nominal,
            chosen=with_prediction_spread(self.fitter, best, self.ordinary),
            singles=singles,
            tied=tuple(f for f in others if self._is_tied(f, best)),
            is_likely=self._is_likely(best, self.nominal),
        )

    def _fit_alike(self, fit: Fit) -> None:
        """Fit what says the same of a robot in place of each effect of a set, to say so."""
        for k in fit.freed:
            one = self.parameters[k]
            for number, other in enumerate(self.parameters):
                alike = one.effect == other.kind.same_as or other.effect == one.kind.same_as
                if alike and other.joint == one.joint and other.nameable:
                    freed = tuple(number if a == k else a for a in fit.freed)
                    u = {a: v for a, v in fit.u.items() if a != k}
                    if frozenset(freed) not in self.tried:
                        self._keep(self.fitter.fit(freed, {**u, number: 2.0 * other.least}))

    def _sets(self, causes: int) -> list[Fit]:
        """The sets tried of so many effects, all of them some, whose replay does not diverge."""
        known = (fit for fit in self.tried.values() if np.isfinite(fit.excess))
        same = (fit for fit in known if len(fit.freed) == causes)
        return [fit for fit in same if is_some(self.parameters, fit)]

    def _polished(self, fits: Sequence[Fit]) -> list[Fit]:
        """Sets by rank; the best are fitted on with the tolerances of all joints.

        And from where these are none, for at their ends they may hold a fit where it is. The best
        of those whose last effect is on a joint, for with what all share all joints' move anyway.
        """
        ranked = self._ranked(fits)
        if len(self.fitter.evidence.joints) == 1:
            return ranked
        own = [fit for fit in ranked if self.parameters[fit.freed[-1]].joint is not None]
        for fit in _near(own[:POLISHED]):
            self._keep(self.fitter.fit(fit.freed, fit.u, slopes=fit.slopes))
            if self.tried[frozenset(fit.freed)].worst > self.ordinary.floors:
                self._keep(self.fitter.fit(fit.freed, self._rough(fit.freed, fit.u).u))
        polished = [self.tried[frozenset(fit.freed)] for fit in ranked]
        return self._ranked([fit for fit in polished if is_some(self.parameters, fit)])

    def _ranked(self, fits: Sequence[Fit]) -> list[Fit]:
        """By what they leave; in an exact world, where gaps are small, by their likelihood."""
        if (
            self.ordinary.exact
            and min((f.worst for f in fits), default=9.0) <= self.ordinary.floors
        ):
            pairs = ranked_by_nats(self.fitter.evidence, fits)
            return [fit for _, fit in sorted(pairs, key=self._nats)]
        return ranked(self.fitter, fits)

    def _nats(self, pair: tuple[float, Fit]) -> float:
        """A fit's cost; of two that are tied, the one that both are in a narrow range leads."""
        cost, fit = pair
        return cost + TIE_NATS * _wider([self.parameters[k] for k in fit.freed])

    def _keep(self, fit: Fit) -> None:
        name = frozenset(fit.freed)
        self.tried[name] = self.fitter.better(fit, self.tried.get(name, fit))

    def _is_worth(self, fit: Fit, now: Fit) -> bool:
        """Whether a set is worth more than the best with one effect less, and needs all of its own.

        The first effect may be a part of what is wrong. What tolerances alone could hide, one
        effect closes.
        """
        if self._is_likely(fit, now):
            return True
        new = [self.parameters[k] for k in fit.freed if k not in now.freed]
        kin = any(self.parameters[k].is_kin(one) for k in now.freed for one in new)
        if kin and set(now.freed) < set(fit.freed):
            return share_of(fit, now) >= SHAPED
        if not now.freed:
            return share_of(fit, now) >= PART
        if self.nominal.strain2:
            return False
        less = chain([now], (self._without(fit, k) for k in fit.freed))
        return all(is_worth(fit, one, self.ordinary, self.nominal) for one in less)

    def _is_likely(self, fit: Fit, now: Fit) -> bool:
        """Whether the world is exact, and a set much more likely than each with one effect less.

        A set that leaves a larger gap fits single moments better, which says nothing of a cause.
        """
        if not self.ordinary.exact or fit.worst > min(self.ordinary.floors, now.worst):
            return False
        before = [now, *(self._without(fit, k) for k in fit.freed)]
        return is_likely(self.fitter.evidence, fit, before, self.nominal)

    def _without(self, fit: Fit, number: int) -> Fit:
        """The set with one effect less, fitted from there as well: its own start may mislead it."""
        rest = tuple(a for a in fit.freed if a != number)
        if (fit.freed, rest) not in self.thinned:
            self.thinned.add((fit.freed, rest))
            less = with_parts(self.parameters, [number])
            u = {a: v for a, v in fit.u.items() if a not in less}
            self._keep(self.fitter.fit(rest, u, slopes=fit.slopes))
        return self.tried[frozenset(rest)]

    def _add(self, fit: Fit) -> None:
        """Fit the most promising sets with one more effect."""
        promising, slopes = self._promising(fit)
        for count, (number, size) in enumerate(promising.items()):
            one, freed = self.parameters[number], (*fit.freed, number)
            joint = one.joint
            where = "all joints" if joint is None else self.fitter.evidence.joints[joint]
            self.progress(
                f"fit of {one.effect} on {where}, {count + 1} of {len(promising)}",
                1.0 - (1.0 - NOMINAL) * 0.5 ** (len(self.tried) / ROUND),
            )
            if size and frozenset(freed) not in self.tried:
                near = [k for k, p in enumerate(self.parameters) if p.joint in (joint, None)]
                moving = None if joint is None else near
                for u, known, again in self._starts(number, size, fit, slopes):
                    beat = self._to_beat(freed)
                    new = self.fitter.fit(freed, u, moving, known, beat=beat, again=again)
                    self._keep(new)
                    if not again and self.tried[frozenset(freed)] is new:
                        self._keep(self.fitter.fit(freed, new.u, moving, new.slopes))

    def _to_beat(self, freed: Sequence[int]) -> float:
        """The excess of another fit of a set, or what the beam would keep of as many effects."""
        same = [one.excess + NEAR_MORE for one in self._sets(len(freed))]
        own = self.tried.get(frozenset(freed))
        return min(same + ([own.excess] if own else []), default=np.inf)

    def _promising(self, fit: Fit) -> tuple[dict[int, float], Slopes]:
        """What to add to a fit with its size, the best first, and the slopes of its tolerances.

        A linear step from a fit that was pulled to a large gap, or that sticks and slips, hides
        what it is. So the first effects are sought from where tolerances are none as well, and
        further ones among those that explain much alone.
        """
        asked = [k for k in range(len(self.parameters)) if self._is_asked(k, fit)]
        is_far = not fit.freed and fit.worst > FAR * self.ordinary.floors
        if is_far:
            fit = self.fitter.fit(u=fit.u, steps=0)
        every, slopes = screened(self.fitter, fit, asked, self.chords)
        found = _first(every, FITTED)
        if is_far:
            plain, _ = screened(self.fitter, self.plain, asked, {})
            more: Sizes = {**_first(plain, MORE), **self._kin(every, found), **self._of_all(found)}
        else:
            singles = {f.freed[0]: f.u[f.freed[0]] for f in self._ranked(self._sets(1))}
            every = {k: u for k, u in self._of_all(found).items() if self.parameters[k].is_unsaid}
            more = {**_first({k: u for k, u in singles.items() if k in asked}, MORE), **every}
        return {**found, **{k: u for k, u in more.items() if k not in found}}, slopes

    def _of_all(self, found: Sizes) -> Sizes:
        """Effects that promise much on a joint, as what all joints share."""
        sizes = dict[str, list[float]]()
        for k, size in found.items():
            sizes.setdefault(self.parameters[k].effect, []).append(size)
        return {
            k: float(np.mean(sizes[one.effect]))
            for k, one in enumerate(self.parameters)
            if one.joint is None and one.kind.per_joint and one.effect in sizes
        }

    def _kin(self, promising: Sizes, found: Sizes) -> Sizes:
        """Effects of a family at a joint: where one promises much, another may be the law."""
        return {
            k: float(np.copysign(KIN * self.parameters[k].least, promising[k]))
            for k in sorted(promising)
            if any(self.parameters[k].is_kin(self.parameters[one]) for one in found)
        }

    def _starts(
        self, number: int, to: float, fit: Fit, slopes: Slopes
    ) -> Iterator[tuple[Sizes, Slopes, bool]]:
        """Where to start from: from where the tolerances are and from where they are none.

        The others of a joint's own effect may stay: what leaves less is where a search begins.
        With dry friction that holds and that yields, and then with the better of them. With slopes,
        and whether these are taken again on the way: a second start is tried roughly. What all
        joints share stands in place of what each has of it: no fit tells these apart. Its size is
        sought before any tolerance moves in its place where a slope misleads: at kinks, beside
        play that rattles, in laws with numbers of their own, and where its fits leave much. What
        all joints share is fitted on where it still leaves much.
        """
        one, freed = self.parameters[number], (*fit.freed, number)
        low, high = 1.1 * one.least, 0.7 * one.most
        size = float(np.sign(to) * np.clip(abs(to), low, high))
        others = {k: v for k, v in fit.u.items() if self.parameters[k].effect != one.effect}
        fit = replace(fit, u=others if one.joint is None else fit.u)
        yield {**fit.u, number: size}, slopes, True
        if self.rubs or one.kind.family == CoulombFriction.family:
            more = ({**fit.u, k: soft, number: size} for k, soft in self.soft.items())
            yield from ((u, slopes, True) for u in more)
        best = self.tried[frozenset(freed)]
        alone = {k: fit.u.get(k, 0.0) for k in with_parts(self.parameters, fit.freed)}
        alone |= {k: best.u.get(k, 0.0) for k in self.soft}
        if one.joint is not None and one.place not in LOADS:
            own = (one.joint, None)
            apart = {k: v for k, v in fit.u.items() if self.parameters[k].joint not in own}
            ways: list[Sizes] = [alone, {**apart, **alone}]
            alone = dict(min(ways, key=lambda u: self.fitter.excess_at({**u, number: size})))
        is_poor = one.joint is None and one.kind.per_joint and best.worst > self.ordinary.floors
        is_wide = len(with_parts(self.parameters, [number])) > 1
        if one.kind.kinked or is_wide or is_poor or self.fitter.evidence.rattles:
            size = self._scanned(number, low, high, size, alone)
        there: Sizes = {**alone, number: size}
        if is_poor and self.rubs:
            there = min(there, {**there, **self.soft}, key=self.fitter.excess_at)
        guesses = bool(self.guessed)
        yield self._rough(freed, there).u if guesses else there, self.plain.slopes, guesses
        best = self.tried[frozenset(freed)]
        if is_poor and best.worst > self.ordinary.floors:
            yield best.u, best.slopes, True

    def _rough(self, freed: Sequence[int], u: Sizes) -> Fit:
        """Effects from u with guessed numbers alone: no tolerance moves in their place."""
        moving = with_parts(self.parameters, (*self.guessed, *freed))
        return self.fitter.fit(freed, {k: u[k] for k in (*moving, *self.soft) if k in u}, moving)

    def _scanned(self, number: int, low: float, high: float, first: float, alone: Sizes) -> float:
        """The size with the sign of `first` that leaves least."""

        def left(size: float) -> float:
            return min(self.fitter.excess_at({**alone, number: float(size)}), DIVERGED)

        sizes = np.sign(first) * np.geomspace(low, high, SCANNED)
        best = int(np.argmin([left(size) for size in sizes]))
        ends = np.sort(sizes[[max(best - 1, 0), min(best + 1, SCANNED - 1)]])
        near = minimize_scalar(
            left, bounds=ends, method="bounded", options={"xatol": FINE * np.ptp(ends)}
        )
        return min(float(near.x), float(sizes[best]), key=left)

    def _is_tied(self, fit: Fit, best: Fit) -> bool:
        """Whether a set of the same size is as good as the best one.

        What all joints may have explains what a joint has of it: that is no other cause.
        """
        unsaid = {self.parameters[k].effect for k in fit.freed if self.parameters[k].is_unsaid}
        if unsaid.intersection(self.parameters[k].effect for k in best.freed):
            return False
        if self.ordinary.exact and fit.worst <= self.ordinary.floors:
            (least, _), (more, _) = ranked_by_nats(self.fitter.evidence, [fit, best])
            return more - least < TIE_NATS
        behind = (fit.excess - best.excess) / max(self.nominal.excess, 1e-9)
        return behind < TIE_SHARE and fit.excess < TIE * best.excess + TIE_MORE

    def _is_asked(self, number: int, fit: Fit) -> bool:
        """Whether an effect may be added to a set."""
        one = self.parameters[number]
        chosen = [self.parameters[k] for k in fit.freed]
        if not one.nameable or number in fit.freed:
            return False
        if sum(p.joint == one.joint for p in chosen) >= EACH:
            return False
        for other in chosen:
            if other.effect == one.effect and None in (other.joint, one.joint):
                return False
        if one.joint is None or one.place in LOADS:
            return True
        own = float(max(fit.gap2[one.joint] - 1.0, 0.0))
        is_all = self.ordinary.exact or fit.strain2 > 0.0
        return is_all or own >= CONCERNED * fit.excess


def _near(ranked: Sequence[Fit]) -> list[Fit]:
    """Those that leave little more than the first, of some or none."""
    return [fit for fit in ranked if fit.excess < NEAR * ranked[0].excess + NEAR_MORE]


def _first(sizes: Sizes, count: int) -> Sizes:
    return dict(islice(sizes.items(), count))


def is_some(parameters: Sequence[Parameter], fit: Fit) -> bool:
    """Whether the effects of a set are all large enough to be some."""
    return all(abs(fit.u[k]) >= parameters[k].least for k in fit.freed)


def ranked(fitter: Fitter, fits: Sequence[Fit]) -> list[Fit]:
    """Sets of causes by what they leave beyond a floor, then by what a fit minimises.

    Of sets that leave nothing beyond it, those lead whose effects are not as large as is tried.
    """
    nats = dict(zip(map(id, fits), costs(fitter.evidence, fits), strict=True))

    def rank(fit: Fit) -> tuple[float, int, float]:
        chosen = [fitter.parameters[k] for k in fit.freed]
        exact = sum(p.kind.exact for p in chosen)
        common = [k for k in fit.freed if fitter.parameters[k].joint is None]
        own = with_parts(fitter.parameters, common)
        shared = sum(fitter.parameters[k].kind.per_joint for k in own)
        times = SENSOR**exact * OWN**shared * WIDER ** _wider(chosen)
        ended = sum(abs(fit.u.get(k, 0.0)) > END * fitter.parameters[k].most for k in fit.freed)
        return times * fit.excess, ended, times * (nats[id(fit)] - fit.prior) + fit.prior

    return sorted(fits, key=rank)


def _wider(parameters: Sequence[Parameter]) -> int:
    """How many effects are others' laws beyond a narrow range."""
    return sum(one.kind.narrow_as is not None for one in parameters)
