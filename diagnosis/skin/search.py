"""The search for the faults of a skin: one after the other, each judged by samples held out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.state import Array
from diagnosis.finding import TIE_NATS, share
from diagnosis.skin.forward_model import Faults, Pressed, joined
from diagnosis.skin.taxel_fits import Fitting, Guess

BLOCK_S = 1.0
"""Blocks that judge each other in turn."""
MOST = 2
"""Faults that are named at once: more of them imitate any other."""
ACCUSE_NATS = 6.0
"""A fault must raise the likelihood of the judging samples by this, and what is unknown as well."""
EXPLAINED = 0.9
"""Faults must take this share of the squared gap, where what they leave is not ordinary."""
ORDINARY_GAP = 1.5
"""What a good skin leaves: the geometry has errors that come again where it is the same."""


class Skins:
    """All samples, and both halves that judge each other."""

    def __init__(self, episodes: Sequence[Pressed], grid: Array) -> None:
        self._fits = [Fitting(half, grid) for half in _split(episodes)]
        self.whole = Fitting(joined(episodes), grid)
        self.bare: Faults | None = None
        """Another skin that a fault may be fitted to."""

    def lead(self, fault: str, start: Faults, faults: Faults, first: str | None = None) -> float:
        """How much better a fault fitted to one half explains the other one [nats].

        Beside the fault that is there `first`, which is fitted again with it, and without.
        """
        gain = 0.0
        for fit, judge in (self._fits, self._fits[::-1]):
            alone = faults if first is None else fit.alone(first, start, faults)
            skin = self.fitted(fault, start, faults, first, fit)
            gain += judge.nats(skin) - judge.nats(alone)
        return gain

    def fitted(
        self,
        fault: str,
        start: Faults,
        faults: Faults,
        first: str | None = None,
        fit: Fitting | None = None,
    ) -> Faults:
        """The skin with a fault, and with the first one refitted, to all samples.

        Or to those of `fit`. A lone fault may explain what a small offset seems to.
        """
        fit = fit or self.whole
        if first is not None:
            return fit.both((first, fault), start, faults)
        skins = [faults] if self.bare is None or self.bare is faults else [faults, self.bare]
        guesses = (fit.guess(fault, skin) for skin in skins)
        return max((faults, *(g.faults for g in guesses if g is not None)), key=fit.nats)

    def cross_validated_gain(self, faults: Faults) -> float:
        """Cross-validated gain of each half on what faults leave of the other one [nats]."""
        one, other = self._fits
        return one.cross_validated_gain(other, faults) + other.cross_validated_gain(one, faults)


@dataclass(frozen=True, kw_only=True)
class Named:
    """A fault that was found."""

    guess: Guess
    lead_nats: float
    ties: tuple[tuple[str, float], ...]
    """Faults that are as near to it as its own lead, and how near [nats]."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """What a search found."""

    named: tuple[Named, ...]
    faults: Faults
    """The skin with them."""
    before: float
    after: float
    """Gaps of the nominal skin and with them."""
    structure_nats: float
    """How well what they leave predicts itself."""

    @property
    def share(self) -> float:
        """Share of the squared gap that they take."""
        return share(self.before, self.after)

    @property
    def is_unknown(self) -> bool:
        """Whether something else is wrong: what is left is not ordinary, or follows a law."""
        strained = any(one.guess.extreme for one in self.named)
        ordinary = self.after <= ORDINARY_GAP or self.share >= EXPLAINED
        return strained or self.structure_nats >= ACCUSE_NATS or not ordinary


def search(skins: Skins, start: Faults, sought: Sequence[str]) -> Found:
    """Faults one after the other, the clearest first, while halves ask for one."""
    named: list[Named] = []
    faults, whole = start, skins.whole
    left = list(sought)
    while left and len(named) < MOST:
        first = named[0].guess.fault if named else None
        leads = {name: skins.lead(name, start, faults, first) for name in left}
        best = max(leads, key=lambda name: leads[name])
        guess = whole.beside(best, start, skins.fitted(best, start, faults, first))
        if guess is None or leads[best] < ACCUSE_NATS:
            break
        faults = guess.faults
        again = (_refitted(one, whole, start, faults) for one in named)
        named = [one for one in again if one is not None]
        named.append(_named(guess, leads))
        left.remove(best)
    return Found(
        named=tuple(named),
        faults=faults,
        before=whole.gap(start),
        after=whole.gap(faults),
        structure_nats=skins.cross_validated_gain(faults),
    )


def _refitted(one: Named, whole: Fitting, start: Faults, faults: Faults) -> Named | None:
    """A fault with the size that it has beside another one; None where that is none."""
    guess = whole.beside(one.guess.fault, start, faults)
    return None if guess is None else replace(one, guess=guess)


def _named(guess: Guess, leads: dict[str, float]) -> Named:
    """A fault with its lead over none and over the next best."""
    lead = leads[guess.fault]
    behind = {name: lead - other for name, other in leads.items() if name != guess.fault}
    return Named(
        guess=guess,
        lead_nats=min([lead, *behind.values()]),
        ties=tuple((name, nats) for name, nats in behind.items() if nats < TIE_NATS),
    )


def _split(episodes: Sequence[Pressed]) -> tuple[Pressed, Pressed]:
    """Two halves that judge each other: every second block, of the next episode the others.

    So each has seen what the other one has at that time, as drift has it.
    """
    turns = [np.floor(p.time_s / BLOCK_S + k) % 2 == 0 for k, p in enumerate(episodes)]
    one = [part.some(turn) for part, turn in zip(episodes, turns, strict=True)]
    other = [part.some(~turn) for part, turn in zip(episodes, turns, strict=True)]
    return joined(one), joined(other)
