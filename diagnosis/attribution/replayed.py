"""Replays of one limb's recordings in worlds with effects; the latest of them are kept.

A fit comes back to where it has been: what it refined is judged, and what was fitted to some
samples is fitted to all.
"""

from collections import OrderedDict
from collections.abc import Sequence
from itertools import takewhile

from backends.effect import Effect, NumberEffect, with_effects
from backends.spec import Spec
from backends.state import Array
from diagnosis.replay.replay import Commands, Told, replays

NUMBERS = 2_000_000
"""Numbers of replays that are kept: 16 MB."""


class Replayed:
    """What worlds with effects show under the commands of the recordings."""

    def __init__(self, nominal: Spec, commands: Sequence[Commands]) -> None:
        self._nominal, self._commands = nominal, tuple(commands)
        self._built: dict[tuple[Effect, ...], Spec] = {}
        self._latest: tuple[tuple[Effect, ...], Spec] = ((), nominal)
        self._shown: OrderedDict[tuple[Effect, ...], dict[int, Array]] = OrderedDict()
        self._told: dict[tuple[tuple[int, int], ...], Told] = {}
        self._kept = 0

    def __reduce__(self) -> tuple:
        """To another process go no replays."""
        return Replayed, (self._nominal, self._commands)

    def world(self, effects: Sequence[Effect]) -> Spec:
        """The nominal world with effects, one after the other."""
        acting = _acting(effects)
        if acting != self._latest[0]:
            first = tuple(takewhile(lambda effect: not isinstance(effect, NumberEffect), acting))
            if first not in self._built:
                self._built[first] = with_effects(self._nominal, first)
            world = with_effects(self._built[first], acting[len(first) :])
            self._latest = acting, world
        return self._latest[1]

    def shown(self, effects: Sequence[Effect], samples: Sequence[int]) -> list[Array]:
        """The first so many samples of each recording, shape (4, T, J); none asked, none shown."""
        acting = _acting(effects)
        known = self._shown.pop(acting, {})
        asked = [k for k, count in enumerate(samples) if count]
        short = [k for k in asked if k not in known or known[k].shape[1] < samples[k]]
        fresh = self._replays(acting, [(k, samples[k]) for k in short]) if short else []
        self._kept += sum(one.size for one in fresh)
        self._kept -= sum(known[k].size for k in short if k in known)
        known.update(zip(short, fresh, strict=True))
        self._shown[acting] = known
        while self._kept > NUMBERS and len(self._shown) > 1:
            _, oldest = self._shown.popitem(last=False)
            self._kept -= sum(one.size for one in oldest.values())
        return [known[k][:, : samples[k]] for k in asked]

    def _replays(self, acting: tuple[Effect, ...], some: list[tuple[int, int]]) -> list[Array]:
        """Replays of some recordings, each with how many samples of it."""
        asked = tuple(some)
        if asked not in self._told:
            self._told[asked] = Told.of([self._commands[k].first(count) for k, count in asked])
        return replays(self.world(acting), self._told[asked])


def _acting(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Those that change the world, and not when it is read."""
    return tuple(e for e in effects if type(e).on_spec is not Effect.on_spec)
