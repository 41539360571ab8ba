"""Faults of the real side: which effects are drawn, how large, and on which joints.

All of it follows from the effects' own facts (`backends.effect.Effect`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from backends.catalogue import catalogue
from backends.effect import Effect
from backends.spec import Body, Spec
from diagnosis.blind import arms, rigs
from diagnosis.blind.plant import MAGNET_SLIP

LEVELS = ("small", "medium", "large")
JITTER = 0.2
"""Largest distance of a magnitude from its level, as a logarithm."""
EVERYWHERE = 0.25
"""Probability that an effect is on all its joints instead of on one."""
NOMINAL_STD, NOMINAL_CLIP = 0.05, 2.0
"""Relative standard deviation of hidden nominal errors, and its cut-off in standard deviations."""
REACH, LEAST_SHARE = 2.0, -0.85
"""Largest magnitudes of drawn robots over the large level, and of what is relative to a number."""
COMPLIANCE = 0.6
"""Their largest compliance of a gear over 1 / kp."""
SLIP_RAD = 0.1
"""Their largest slip of a magnet."""


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


def in_free_air() -> tuple[str, ...]:
    """Effects that hands show in free air: their joints are upright."""
    return tuple(name for name in _free() if not catalogue()[name].by_weight)


def _free() -> tuple[str, ...]:
    """Effects that show in free air."""
    return tuple(
        name for name, kind in catalogue().items() if kind.drawn and not kind.shows_in_hand()
    )


def in_hand() -> tuple[str, ...]:
    """Effects that show only with the stick in the hand: touch, stick and contact."""
    return tuple(name for name, kind in catalogue().items() if kind.drawn and kind.shows_in_hand())


def of_arms() -> tuple[str, ...]:
    """Effects that an arm can have: its file has no gear whose damping could be off."""
    kinds = catalogue()
    return tuple(n for n in _free() if not (is_of_gear(kinds[n]) and kinds[n].either_sign))


def is_of_gear(kind: type[Effect]) -> bool:
    """Whether it changes a number of a gear, which an arm's file does not have."""
    return any(number.startswith("drive.gear_") for number in kind.spec_fields())


def of_level(name: str, level: str, spec: Spec, rng: np.random.Generator) -> Fault:
    """An effect near one of its levels, to one of its sides, on one joint or on all."""
    kind = catalogue()[name]
    joint = _joint(kind, spec, rng)
    levels = side(kind, rng)
    amount = levels[LEVELS.index(level)] * np.exp(rng.uniform(-JITTER, JITTER))
    magnitude = float(np.clip(amount * natural(kind, joint, spec), *kind.bounds))
    return Fault(effect=name, joint=joint, magnitude=magnitude, level=level)


def side(kind: type[Effect], rng: np.random.Generator) -> tuple[float, float, float]:
    """The levels of an effect to one of its sides at random."""
    return kind.opposite if kind.opposite is not None and rng.integers(2) else kind.levels


def natural(kind: type[Effect], joint: str | None, spec: Spec) -> float:
    """The smallest natural size of an effect among the joints that it is on."""
    drives = [b.joint.drive for b in spec.hand.driven if joint in (None, b.joint.name)]
    return min(kind.natural(drive) for drive in drives if drive is not None)


def _joint(kind: type[Effect], spec: Spec, rng: np.random.Generator) -> str | None:
    """One joint at random; None for all of those that an effect concerns, if there are more."""
    if not kind.per_joint:
        return None
    able = [b.joint for b in spec.hand.driven if kind.refusal(b) is None]
    concerned = [joint for joint in able if kind.gear in (None, joint.gear)]
    everywhere = rng.uniform() < EVERYWHERE and len(concerned) > 1
    names = [joint.name for joint in able]
    return None if everywhere else names[rng.integers(len(names))]


def arm_joint(name: str, spec: Spec, rng: np.random.Generator) -> str | None:
    """One joint at random; None: all of them, if a bus or controller gives it to all alike."""
    kind = catalogue().get(name)
    able = [b for b in spec.hand.driven if kind is None or kind.refusal(b) is None]
    names = [body.joint.name for body in able]
    everywhere, one = rng.uniform() < EVERYWHERE, names[rng.integers(len(names))]
    if kind is None or (kind.per_joint and not (everywhere and kind.shared and len(names) > 1)):
        return one
    return None


def largest(name: str, joint: str | None, spec: Spec, rng: np.random.Generator) -> float:
    """The largest magnitude of a drawn robot's fault, to one of its sides at random."""
    if name == MAGNET_SLIP:
        return float(SLIP_RAD * rng.choice([-1.0, 1.0]))
    bodies = [b for b in spec.hand.driven if joint in (None, b.joint.name)]
    drives = [b.joint.drive for b in bodies if b.joint.drive is not None]
    kind = catalogue()[name]
    if kind.coordinate == "compliance":
        return COMPLIANCE * min(d.gear_stiffness_nm_rad / d.kp_nm_rad for d in drives)
    if kind.coordinate == "reach":
        room = min(np.ptp(b.joint.range_rad) for b in bodies) / 2
        return float(np.sign(side(kind, rng)[-1]) * room)
    return max(REACH * side(kind, rng)[-1], LEAST_SHARE) * natural(kind, joint, spec)


def nominal_errors(
    spec: Spec,
    faults: Sequence[Fault],
    rng: np.random.Generator,
    std: float = NOMINAL_STD,
    clip: float = NOMINAL_CLIP,
) -> Iterator[Fault]:
    """An error of every nominal number that no fault changes: there the truth is the fault's."""
    for name, kind in catalogue().items():
        for body in spec.hand.driven if kind.nominal else ():
            share = std * np.clip(rng.normal(), -clip, clip)
            size = 1.0 if kind.dimension == "share" else number_of(kind, body)
            joint = body.joint.name
            taken = any(f.effect == name and f.joint in (None, joint) for f in faults)
            if size != 0.0 and not taken:
                yield Fault(effect=name, joint=joint, magnitude=float(share * size))


def number_of(kind: type[Effect], body: Body) -> float:
    """The number of a joint's drive that an effect changes."""
    (number,) = kind.spec_fields()
    return float(getattr(body.joint.drive, number.removeprefix("drive.")))


def of_robot(rig: str, faults: Sequence[Fault]) -> tuple[Fault, ...]:
    """Errors of a drawn robot's nominal numbers, except those that a fault changes."""
    seed = rigs.robot(rig)
    assert seed is not None
    rng, spread = np.random.default_rng([seed, 3]), arms.spread(seed)
    drawn = nominal_errors(rigs.nominal(rig), faults, rng, spread, arms.CLIP / spread)
    return tuple(error for error in drawn if not is_of_gear(catalogue()[error.effect]))
