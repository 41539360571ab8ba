"""The search for the faults of a skin: the smallest set that takes the gap, as for any robot.

All sets of as many faults are fitted to all samples, and the smallest is named that takes its share
of the squared gap beyond one floor (`verdict.ordinary`) and leaves no more than a floor and the
law's own error. The geometry says how deep taxels are pressed, so the law of their answers is
exact: likelihoods name as well what leaves less than shows in a gap (`verdict.exact`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from diagnosis.skin.forward_model import Faults
from diagnosis.skin.taxel_fits import Fitting, Guess
from diagnosis.verdict.exact import ACCUSE_NATS, TIE_NATS
from diagnosis.verdict.ordinary import SHARE, SIMULATORS, allowed, share_of

MOST = 2
"""Faults that are named at once: more of them imitate any other."""
LAW = replace(SIMULATORS, floors=1.0)
"""The right faults leave a floor, and what their law is off by."""
HEALTHY = 1.5
"""A good skin leaves this gap: the geometry has errors that come again where it is the same."""


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A set of faults at the sizes that fit best together."""

    guesses: tuple[Guess, ...]
    skin: Faults
    worst: float
    """The gap that it leaves."""
    nats: float
    """Log-likelihood of the samples."""

    @property
    def excess(self) -> float:
        """The squared gap beyond one floor."""
        return max(self.worst**2 - 1.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faults."""
        return tuple(guess.fault for guess in self.guesses)


@dataclass(frozen=True, kw_only=True)
class SkinFit:
    """What a search found."""

    nominal: Tried
    chosen: Tried
    """The smallest set that explains the samples; `nominal` where none does."""
    tied: tuple[Tried, ...]
    """Sets of the same size that this log cannot tell from the chosen one."""

    @property
    def share(self) -> float:
        """Share of the squared gap that the chosen set takes."""
        return max(share_of(self.chosen, self.nominal), 0.0)

    @property
    def is_unknown(self) -> bool:
        """Whether no set explains an odd gap, or its size is at the end of what there is."""
        odd = not self.chosen.guesses and self.nominal.worst > HEALTHY
        return odd or any(guess.extreme for guess in self.chosen.guesses)


def search(fitting: Fitting, starts: Sequence[Faults], sought: Sequence[str]) -> SkinFit:
    """The faults of a skin: the smallest set that explains its samples.

    `starts`: the skin beside which faults are sought, and others that a lone one may be fitted to.
    """
    nominal = _tried(fitting, starts[0])
    now, tied = nominal, tuple[Tried, ...]()
    for count in range(1, MOST + 1):
        if count > 1 and not now.guesses and now.worst <= LAW.floors:
            break
        sets = sorted(_sets(fitting, starts, sought, count), key=lambda one: -one.nats)
        if sets and _explains(sets[0], now, nominal):
            now = sets[0]
            tied = tuple(one for one in sets[1:] if now.nats - one.nats < TIE_NATS)
    return SkinFit(nominal=nominal, chosen=now, tied=tied)


def _sets(
    fitting: Fitting, starts: Sequence[Faults], sought: Sequence[str], count: int
) -> Iterator[Tried]:
    """All sets of so many faults that are some."""
    for names in combinations(sought, count):
        fits = [(fitting.together(names, start), start) for start in starts[: 3 - count]]
        skin, start = max(fits, key=lambda fit: fitting.nats(fit[0]))
        guesses = [guess for name in names if (guess := fitting.beside(name, start, skin))]
        if len(guesses) == count:
            yield _tried(fitting, skin, guesses)


def _tried(fitting: Fitting, skin: Faults, guesses: Sequence[Guess] = ()) -> Tried:
    worst, nats = fitting.gap(skin), fitting.nats(skin)
    return Tried(guesses=tuple(guesses), skin=skin, worst=worst, nats=nats)


def _explains(one: Tried, now: Tried, nominal: Tried) -> bool:
    """Whether a set leaves the noise, and takes its share of the gap or is by far likelier."""
    takes = not now.guesses and share_of(one, nominal) >= SHARE
    worth = takes or one.nats - now.nats >= ACCUSE_NATS
    return worth and one.worst <= allowed(nominal.worst, LAW)
