"""Draw what is hidden in a set of cases: a pure function of settings and seed; knows no solver.

Sides, rigs, effects and levels are dealt from shuffled decks, so that a small set is balanced and a
case's number says nothing about its contents.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from diagnosis.blind import arms, motion, rigs, sides

T = TypeVar("T")
SHARES = {"single": 6, "pair": 2, "none": 2, "unknown": 3}
"""Proportions of the modes among all cases."""
LEVELS = ("small", "medium", "large")
JITTER = 0.2
"""Largest distance of a magnitude from its level, as a logarithm."""
EVERYWHERE = 0.25
"""Probability that an effect is on all its joints instead of on one."""
NOMINAL_STD, NOMINAL_CLIP = 0.05, 2.0
"""Relative standard deviation of hidden nominal errors, and its cut-off in standard deviations."""
NOMINAL = {
    "kp-scale": None,
    "kd-scale": None,
    "coulomb-friction": "coulomb_nm",
    "viscous-friction": "viscous_nms_rad",
    "rotor-inertia": "rotor_inertia_kgm2",
    "link-mass": None,
    "series-elasticity": None,
    "gear-damping": None,
}
"""Nominal parameters that have errors, by the effect that changes them, and their reference
value."""
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


@dataclass(frozen=True, kw_only=True)
class Size:
    """The three magnitudes of an effect."""

    levels: tuple[float, float, float]
    """Zeros if it only decreases."""
    of: str | None = None
    """Drive number to which they are relative; None: SI units or shares."""
    falls: tuple[float, float, float] | None = None
    """Magnitudes of the other sign, as positive numbers, if it has both signs."""


_SHARE_EITHER = ((0.1, 0.25, 0.6), (0.1, 0.25, 0.5))
SIZES = {
    "backlash": Size(levels=(0.003, 0.009, 0.026)),
    "self-lock": Size(levels=(0.02, 0.08, 0.3), of="torque_limit_nm"),
    "coulomb-friction": Size(levels=(0.01, 0.04, 0.12), of="torque_limit_nm"),
    "stiction": Size(levels=(0.01, 0.04, 0.12), of="torque_limit_nm"),
    "viscous-friction": Size(levels=(0.1, 0.3, 0.8), of="kd_nms_rad"),
    "load-friction": Size(levels=(0.05, 0.15, 0.4)),
    "series-elasticity": Size(levels=(0.2, 0.6, 2.0)),
    "rotor-inertia": Size(levels=(0.2, 0.6, 2.0), of="rotor_inertia_kgm2"),
    "link-mass": Size(levels=(0.3, 0.8, 2.0)),
    "gravity-tilt": Size(levels=(0.03, 0.1, 0.3), falls=(0.03, 0.1, 0.3)),
    "kp-scale": Size(levels=_SHARE_EITHER[0], falls=_SHARE_EITHER[1]),
    "kd-scale": Size(levels=_SHARE_EITHER[0], falls=_SHARE_EITHER[1]),
    "gear-damping": Size(levels=(0.2, 0.4, 0.8), falls=(0.2, 0.4, 0.7)),
    "torque-limit": Size(levels=(0.0, 0.0, 0.0), falls=(0.15, 0.3, 0.5)),
    "command-delay": Size(levels=(0.002, 0.006, 0.02)),
    "command-rate-limit": Size(levels=(0.1, 0.3, 1.0)),
    "command-dropout": Size(levels=(0.05, 0.15, 0.4)),
    "dead-zone": Size(levels=(0.002, 0.006, 0.02)),
    "encoder-bias": Size(levels=(0.002, 0.007, 0.025), falls=(0.002, 0.007, 0.025)),
    "encoder-scale": Size(levels=(0.01, 0.03, 0.1), falls=(0.01, 0.03, 0.1)),
    "encoder-resolution": Size(levels=(0.002, 0.006, 0.02)),
    "encoder-noise": Size(levels=(5e-4, 1.5e-3, 5e-3)),
    "sensor-delay": Size(levels=(0.002, 0.006, 0.02)),
}
"""Sizes by effect, of those that show in free air."""
HELD_SIZES = {
    "taxel-threshold": Size(levels=(5e-5, 1.5e-4, 4e-4), falls=(4e-5, 8e-5, 1.5e-4)),
    "taxel-drift": Size(levels=(2e-5, 7e-5, 2.5e-4)),
    "taxel-dropout": Size(levels=(0.05, 0.15, 0.4)),
    "taxel-halo": Size(levels=(0.003, 0.005, 0.008)),
    "stick-radius": Size(levels=(0.03, 0.08, 0.2), falls=(0.03, 0.08, 0.2)),
    "stick-mass": Size(levels=(0.3, 0.8, 2.0), falls=(0.2, 0.4, 0.7)),
    "contact-friction": Size(levels=(0.15, 0.3, 0.6), falls=(0.15, 0.3, 0.5)),
    "contact-softness": Size(levels=(4e-5, 1e-4, 2.5e-4)),
}
"""Sizes of effects that show only with the stick in the hand: touch, stick and contact. A grasp
presses by up to 12 N, and engines hold a stick while contacts yield less than 3.5 mm."""
EFFECTS, HELD_EFFECTS = tuple(SIZES), tuple(HELD_SIZES)
ARM_EFFECTS = tuple(effect for effect in EFFECTS if effect != "gear-damping")
"""What an arm can have: its file has no gear whose damping could be off."""
NO_GEAR = ("series-elasticity", "gear-damping")
"""Nominal numbers that an arm's file does not have."""
SHARED = ("kp-scale", "kd-scale", "command-delay", "command-dropout", "sensor-delay")
"""Of these what a bus or a controller gives to all joints of an arm alike."""
TIMES = (3.0, 30.0)
"""What drawn robots leave with a fault, over what they leave without."""
EXCLUSIVE = ({"backlash", "series-elasticity"},)
"""Effects of arms that are no pair: one second hinge has play or a spring."""
SLIPPING = ("stick-mass", "contact-friction")
"""Of these, the effects that show where the stick slips."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """An effect on the real side."""

    effect: str
    joint: str | None
    """None: all joints that it concerns."""
    magnitude: float
    """In SI units or as a share."""
    level: str = ""
    """One of LEVELS; empty for a nominal error."""


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
    effects: tuple[str, ...] = EFFECTS
    protocols: tuple[str, ...] = motion.PROTOCOLS
    channels: tuple[tuple[str, ...], ...] = CHANNELS
    variants: int = 2
    healthy: int = 0
    """Logs of sound mechanisms that the solver is given: of the same real side, rig and channels,
    of a drawn robot those of this very one before anything was wrong."""
    times: tuple[float, float] = TIMES
    """Of drawn robots: between which ends `Case.times` lie, evenly in their logarithm."""


def draw(settings: Settings, catalogue: Mapping[str, type[Effect]], seed: int) -> tuple[Case, ...]:
    """Draw the cases of a set; the same seed gives the same cases."""
    rng = np.random.default_rng([seed, 0])
    modes = [m for m, count in _counts(settings).items() for _ in range(count)]
    reals = itertools.islice(_deck(settings.reals, rng), settings.cases)
    rigs_ = itertools.islice(_deck(rigs.members(settings.rigs), rng), settings.cases)
    channels = itertools.islice(_deck(settings.channels, rng), settings.cases)
    decks = {mode: _effects(settings.effects, rng) for mode in settings.modes}
    strange = _strange(settings, seed)
    rows = list(zip(modes, reals, rigs_, channels, strict=True))
    dealt = [
        _deal(
            strange[real] if mode == "unknown" and real in strange else decks[mode],
            {"pair": 2, "none": 0}.get(mode, 1),
        )
        for mode, real, *_ in rows
    ]
    places = rng.permutation(settings.cases)
    cases = []
    for number, place in enumerate(places):
        mode, real, kind, logged = rows[place]
        rig = rigs.individual(kind, np.random.default_rng([seed, 4, number]))
        deal = _robot if rigs.robot(rig) is not None else _hidden
        hidden = deal(mode, rig, dealt[place], settings, catalogue, [seed, 1, number])
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


def sound(settings: Settings, cases: Sequence[Case], seed: int) -> dict[Make, tuple[Case, ...]]:
    """Healthy cases of every plant: only other nominal errors are hidden; in random order."""
    rng = np.random.default_rng([seed, 3])
    makes = list(dict.fromkeys(case.make for case in cases))
    found: dict[Make, tuple[Case, ...]] = {}
    for group, (real, rig, channels) in enumerate(makes[k] for k in rng.permutation(len(makes))):
        seeded = rigs.robot(rig) is not None
        robot = nominal_errors(rig, ()) if seeded else None
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
                nominal=tuple(_nominal(rigs.nominal(rig), (), rng)) if robot is None else robot,
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


def _deal(deck: Iterator[tuple[str, str]], count: int) -> list[tuple[str, str]]:
    """Effects with their levels, each effect once."""
    dealt: list[tuple[str, str]] = []
    while len(dealt) < count:
        card = next(deck)
        if card[0] not in [effect for effect, _ in dealt]:
            dealt.append(card)
    return dealt


def _hidden(
    mode: str,
    rig: str,
    dealt: list[tuple[str, str]],
    settings: Settings,
    catalogue: Mapping[str, type[Effect]],
    seed: list[int],
) -> dict:
    """The faults of a case, its nominal errors and what the solver's catalogue lacks."""
    rng, spec = np.random.default_rng(seed), rigs.nominal(rig)
    faults = tuple(_fault(name, level, catalogue[name], spec, rng) for name, level in dealt)
    others = [name for name in settings.effects if name not in [f.effect for f in faults]]
    excluded = faults[0].effect if mode == "unknown" else others[rng.integers(len(others))]
    nominal = tuple(_nominal(spec, faults, rng))
    return {"faults": faults, "nominal": nominal, "excluded": (excluded,)}


def _strange(settings: Settings, seed: int) -> dict[str, Iterator[tuple[str, str]]]:
    """Decks of faults outside of the catalogue, of the real sides of drawn robots that have any."""
    if not set(rigs.members(settings.rigs)) <= set(rigs.ARMS):
        return {}
    found = {real: sides.strange(real) for real in settings.reals}
    return {
        real: _effects(names, np.random.default_rng([seed, 6, k]))
        for k, (real, names) in enumerate(found.items())
        if names
    }


def _robot(
    mode: str,
    rig: str,
    dealt: list[tuple[str, str]],
    settings: Settings,
    catalogue: Mapping[str, type[Effect]],
    seed: list[int],
) -> dict:
    """As `_hidden` of a drawn robot; `sizing` says how large its faults are."""
    rng, spec = np.random.default_rng(seed), rigs.nominal(rig)
    faults = tuple(
        Fault(effect=name, joint=arm_joint(name, catalogue, spec, rng), magnitude=0.0)
        for name, _ in dealt
    )
    others = [name for name in settings.effects if name not in [f.effect for f in faults]]
    excluded = faults[0].effect if mode == "unknown" else others[rng.integers(len(others))]
    return {
        "faults": faults,
        "nominal": nominal_errors(rig, faults),
        "excluded": (excluded,),
    }


def arm_joint(
    name: str, catalogue: Mapping[str, type[Effect]], spec: Spec, rng: np.random.Generator
) -> str | None:
    """One joint at random; None: all of them, if the effect can be on all."""
    names = spec.hand.joint_names
    everywhere, one = rng.uniform() < EVERYWHERE, names[rng.integers(len(names))]
    if name in catalogue and not catalogue[name].per_joint:
        return None
    return None if everywhere and name in SHARED and len(names) > 1 else one


def nominal_errors(rig: str, faults: Sequence[Fault]) -> tuple[Fault, ...]:
    """Errors of a drawn robot's nominal parameters, except those that a fault changes."""
    seed = rigs.robot(rig)
    assert seed is not None
    rng, spread = np.random.default_rng([seed, 3]), arms.spread(seed)
    drawn = _nominal(rigs.nominal(rig), faults, rng, spread, arms.CLIP / spread)
    return tuple(error for error in drawn if error.effect not in NO_GEAR)


def _fault(
    name: str, level: str, kind: type[Effect], spec: Spec, rng: np.random.Generator
) -> Fault:
    size, index = (SIZES | HELD_SIZES)[name], LEVELS.index(level)
    joint = _joint(kind, spec, rng)
    rises = size.falls is None or (size.levels[index] > 0 and bool(rng.integers(2)))
    amount = size.levels[index] if rises or size.falls is None else -size.falls[index]
    amount *= np.exp(rng.uniform(-JITTER, JITTER))
    if size.of is not None:
        amount *= min(
            getattr(b.joint.drive, size.of)
            for b in spec.hand.driven
            if joint in (None, b.joint.name)
        )
    magnitude = float(np.clip(amount, *kind.bounds))
    return Fault(effect=name, joint=joint, magnitude=magnitude, level=level)


def _joint(kind: type[Effect], spec: Spec, rng: np.random.Generator) -> str | None:
    """One joint at random; None for all of those that an effect concerns, if there are more."""
    if not kind.per_joint:
        return None
    concerned = [b for b in spec.hand.driven if kind.gear in (None, b.joint.gear)]
    everywhere = rng.uniform() < EVERYWHERE and len(concerned) > 1
    names = spec.hand.joint_names
    return None if everywhere else names[rng.integers(len(names))]


def _nominal(
    spec: Spec,
    faults: Sequence[Fault],
    rng: np.random.Generator,
    std: float = NOMINAL_STD,
    clip: float = NOMINAL_CLIP,
) -> Iterator[Fault]:
    """An error of every nominal parameter that no fault changes: there the truth is the fault's."""
    for name, number in NOMINAL.items():
        for body in spec.hand.driven:
            share = std * np.clip(rng.normal(), -clip, clip)
            size = 1.0 if number is None else getattr(body.joint.drive, number)
            joint = body.joint.name
            taken = any(f.effect == name and f.joint in (None, joint) for f in faults)
            if size != 0.0 and not taken:
                yield Fault(effect=name, joint=joint, magnitude=float(share * size))
