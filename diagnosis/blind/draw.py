"""Draw what is hidden in a set of cases: a pure function of settings and seed; knows no solver.

Sides, rigs, effects and levels are dealt from shuffled decks, so that a small set is balanced and a
case's number says nothing about its contents.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from diagnosis.blind import motion, rigs, sides
from diagnosis.blind.faults import (
    LEVELS,
    Fault,
    arm_joint,
    in_free_air,
    nominal_errors,
    of_level,
    of_robot,
)
from diagnosis.blind.plant import MAGNET_SLIP

T = TypeVar("T")
SHARES = {"single": 6, "pair": 2, "none": 2, "unknown": 3}
"""Proportions of the modes among all cases."""
CHANNELS = (("position",), ("position", "torque"), ("position", "motor"))
"""Sets of logged channels, one of which is drawn."""
HELD_CHANNELS = (
    ("position", "stick", "contact"),
    ("position", "torque", "stick", "contact"),
    ("position", "torque", "stick", "touch"),
)
"""The same where the stick is held."""
ARM_CHANNELS = CHANNELS[:2]
"""The same of arms."""
TIMES = (3.0, 30.0)
"""What drawn robots leave with a fault, over what they leave without."""


Make = tuple[str, str, tuple[str, ...]]
"""Real side, rig and channels of a mechanism."""
SOUND = 1000
"""Healthy logs are numbered from here on, cases below."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case with its answer."""

    number: int
    mode: str
    """single, pair, none or unknown."""
    real: str
    """The real side: an engine or a plant."""
    rig: str
    channels: tuple[str, ...]
    protocols: tuple[str, ...]
    variants: int
    """Episodes per protocol."""
    faults: tuple[Fault, ...]
    """The hidden effects."""
    nominal: tuple[Fault, ...]
    """Errors of the nominal parameters, within their uncertainty."""
    excluded: tuple[str, ...]
    """Effects that the solver's catalogue lacks; in `unknown` the true one, else any other.

    None on a robot that can have faults which are in no catalogue.
    """
    times: tuple[float, ...] = ()
    """Of a drawn robot: what each fault moves beyond its tolerances, over what it leaves without.
    """
    residual_floors: float | None = None
    """Of a drawn robot: what it leaves beside its model while nothing is wrong, in floors."""
    left_floors: float | None = None
    """Of a drawn robot: what it leaves with all its faults, in floors; see `sizing`."""

    @property
    def make(self) -> Make:
        """What healthy logs have in common with this case."""
        return self.real, self.rig, self.channels


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of a set."""

    cases: int
    reals: tuple[str, ...]
    rigs: tuple[str, ...] = ("finger",)
    modes: tuple[str, ...] = tuple(SHARES)
    effects: tuple[str, ...] = field(default_factory=in_free_air)
    protocols: tuple[str, ...] = motion.PROTOCOLS
    channels: tuple[tuple[str, ...], ...] = CHANNELS
    variants: int = 2
    healthy: int = 0
    """Logs of sound mechanisms that the solver is given: of the same real side, rig and channels,
    of a drawn robot those of this very one before anything was wrong."""
    times: tuple[float, float] = TIMES
    """Of drawn robots: between which ends `Case.times` lie, evenly in their logarithm."""


def draw(settings: Settings, seed: int) -> tuple[Case, ...]:
    """Draw the cases of a set; the same seed gives the same cases."""
    _check(settings)
    rng = np.random.default_rng([seed, 0])
    modes = [m for m, count in _counts(settings).items() for _ in range(count)]
    reals = itertools.islice(_deck(settings.reals, rng), settings.cases)
    rigs_ = itertools.islice(_deck(rigs.members(settings.rigs), rng), settings.cases)
    channels = itertools.islice(_deck(settings.channels, rng), settings.cases)
    decks = {mode: _effects(settings.effects, rng) for mode in settings.modes}
    rows = list(zip(modes, reals, rigs_, channels, strict=True))
    strange = set(sides.PLANTS) if set(rigs.members(settings.rigs)) <= set(rigs.ARMS) else set()
    dealt = [
        [(MAGNET_SLIP, "")]
        if mode == "unknown" and real in strange
        else _deal(decks[mode], {"pair": 2, "none": 0}.get(mode, 1), real)
        for mode, real, *_ in rows
    ]
    places = rng.permutation(settings.cases)
    cases = []
    for number, place in enumerate(places):
        mode, real, kind, logged = rows[place]
        rig = rigs.individual(kind, np.random.default_rng([seed, 4, number]))
        hidden = _hidden(mode, rig, dealt[place], settings, [seed, 1, number])
        if real in strange:
            hidden["excluded"] = ()
        cases.append(
            Case(
                number=number,
                mode=mode,
                real=real,
                rig=rig,
                channels=logged,
                protocols=settings.protocols,
                variants=settings.variants,
                **hidden,
            )
        )
    return tuple(cases)


def _check(settings: Settings) -> None:
    """Raise ValueError where a real side knows no two of the effects."""
    for real in settings.reals:
        if sum(sides.has(real, name) for name in settings.effects) < 2:
            known = ", ".join(name for name in in_free_air() if sides.has(real, name))
            raise ValueError(f"{real} knows fewer than two of the effects; it knows {known}")


def sound(settings: Settings, cases: Sequence[Case], seed: int) -> dict[Make, tuple[Case, ...]]:
    """Healthy cases of every plant: only other nominal errors are hidden; in random order."""
    rng = np.random.default_rng([seed, 3])
    makes = list(dict.fromkeys(case.make for case in cases))
    found: dict[Make, tuple[Case, ...]] = {}
    for group, (real, rig, channels) in enumerate(makes[k] for k in rng.permutation(len(makes))):
        found[real, rig, channels] = tuple(
            Case(
                number=SOUND + settings.healthy * group + k,
                mode="none",
                real=real,
                rig=rig,
                channels=channels,
                protocols=settings.protocols,
                variants=settings.variants,
                faults=(),
                nominal=_nominal(rig, (), rng),
                excluded=(),
            )
            for k in range(settings.healthy)
        )
    return found


def _counts(settings: Settings) -> dict[str, int]:
    """Cases per mode, in proportion to SHARES, largest remainders first."""
    whole = sum(SHARES[m] for m in settings.modes)
    exact = {m: settings.cases * SHARES[m] / whole for m in settings.modes}
    counts = {m: int(share) for m, share in exact.items()}
    rest = sorted(settings.modes, key=lambda m: counts[m] - exact[m])
    for mode in rest[: settings.cases - sum(counts.values())]:
        counts[mode] += 1
    return counts


def _deck(cards: Sequence[T], rng: np.random.Generator) -> Iterator[T]:
    """Cards in random order, all of them before any comes again."""
    while True:
        yield from (cards[k] for k in rng.permutation(len(cards)))


def _effects(names: Sequence[str], rng: np.random.Generator) -> Iterator[tuple[str, str]]:
    """Effects in random order, every one before any comes again, then at another level."""
    first = rng.integers(len(LEVELS), size=len(names))
    for turn in itertools.count():
        for k in rng.permutation(len(names)):
            yield names[k], LEVELS[(first[k] + turn) % len(LEVELS)]


def _deal(deck: Iterator[tuple[str, str]], count: int, real: str) -> list[tuple[str, str]]:
    """Effects that a real side knows with their levels, each effect once."""
    dealt: list[tuple[str, str]] = []
    while len(dealt) < count:
        effect, level = next(deck)
        if sides.has(real, effect) and effect not in [other for other, _ in dealt]:
            dealt.append((effect, level))
    return dealt


def _hidden(
    mode: str, rig: str, dealt: list[tuple[str, str]], settings: Settings, seed: list[int]
) -> dict:
    """The faults of a case, its nominal errors and what the solver's catalogue lacks.

    How large the faults of a drawn robot are, `sizing` says.
    """
    rng, spec = np.random.default_rng(seed), rigs.nominal(rig)
    faults = tuple(
        of_level(name, level, spec, rng)
        if rigs.robot(rig) is None
        else Fault(effect=name, joint=arm_joint(name, spec, rng), magnitude=0.0)
        for name, level in dealt
    )
    others = [name for name in settings.effects if name not in [f.effect for f in faults]]
    excluded = faults[0].effect if mode == "unknown" else others[rng.integers(len(others))]
    return {"faults": faults, "nominal": _nominal(rig, faults, rng), "excluded": (excluded,)}


def _nominal(rig: str, faults: Sequence[Fault], rng: np.random.Generator) -> tuple[Fault, ...]:
    """Errors of the nominal numbers, which a drawn robot has of its own."""
    if rigs.robot(rig) is not None:
        return of_robot(rig, faults)
    return tuple(nominal_errors(rigs.nominal(rig), faults, rng))
