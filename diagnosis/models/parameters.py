"""The parameters of a limb: what may be wrong on each joint, from the effects' own facts.

A parameter is an effect on a joint, varied in its coordinate u (`Effect.coordinate`). Every robot
is a little off in most of them: so much a fit may always take. An effect is a parameter that may
take any size within its bounds.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from backends.catalogue import Catalogue
from backends.catalogue import catalogue as every_effect
from backends.effect import Effect, NumberEffect
from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.motion import columns as c
from diagnosis.motion.along import AXES
from diagnosis.motion.blocked import Blocked, blocked
from diagnosis.motion.limb import Limb
from diagnosis.motion.ripple import ripples


class _Integral(NumberEffect):
    """Relative change of an integral gain: as unsure as other gains, and no cause."""

    number = "loop.integral_hz"
    dimension, unit = "share", "%"
    bounds = (-0.9, 9.0)
    relative = True
    nominal = True
    coordinate = "logarithm"
    least, most = 0.1, 2.5
    either_sign = True


class _SpeedIntegral(_Integral):
    """The same of a loop on the speed."""

    number = "loop.speed_integral_hz"


class _OwnSteps(NumberEffect):
    """How far a log is of its model's own simulator: of its step and integrator."""

    number = "own steps"
    dimension, unit = "share", "%"
    bounds = (0.0, 1.0)
    by_column = True
    least = 1.0


class _SoftFriction(_OwnSteps):
    """Dry friction yields under load, as MuJoCo's own does, or holds, as a robot's."""

    number = "loop.soft_friction"
    by_column = False


class _Spot(NumberEffect):
    """Where on its link an effect acts."""

    least = 0.1
    most = 10.0
    either_sign = True


class _Stiffness(_Spot):
    """How much stiffer what is in a joint's way is than it seems."""

    coordinate = "logarithm"


TERMS: Catalogue = {"ki": _Integral, "speed_integral": _SpeedIntegral}
"""Nominal numbers that no effect changes, by their names in log.yaml."""
OWN = 0.4
"""Standard deviation of the share of its model's own simulator that a log has: at most all."""
SPOT = 0.5
"""Standard deviation of where a load or a spring acts, in units of `_spots`."""
APART = 0.05
"""Standard deviation by which joints differ in an effect that no file says, in natural sizes."""
FIRM, GUESS = 3.0, 1.5
"""A stop's stiffness over the servo's, where a log does not show it before its size, and the
standard deviation of its logarithm."""
TURNS, ONCE_RAD = 3.0, 0.1
"""Units of where a spring rests [rad, or a slide's travels], and of what goes once per turn."""
LATE_SHARE = 0.03
"""Commands are late by so much of a log's period anyway."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """An effect on a joint, in its coordinate u."""

    effect: str
    kind: type[Effect]
    joint: int | None
    """Number of its joint; None: all joints have the same of it."""
    place: int
    """Its column of the joints' numbers, or of a tilt the axis (`motion.along.AXES`)."""
    unit: float
    """Natural size: how much the number (or its inverse) grows per u, SI; 1 of a logarithm."""
    onset: float = 0.0
    """Where the number's change begins to show, SI: its size at u = 0 as soon as there is any."""
    tolerance: float
    """Standard deviation of u on a healthy robot; 0: healthy robots have none."""
    centre: float = 0.0
    """Where a healthy robot has it."""
    in_file: float = 0.0
    """Of an amount, what the mechanism's file says: a healthy robot may have as much less."""
    least: float
    """From which size of u on it is an effect."""
    most: float
    """Largest size of u."""
    beside: tuple[tuple[int, float], ...] = ()
    """Other numbers of its law, by their columns, that the log shows before its size [SI]."""
    nameable: bool = True
    """Whether it may be let free as an effect, instead of as a tolerance alone."""
    part_of: int | None = None
    """Number of the parameter whose law it belongs to: it moves only where that is free."""

    def is_kin(self, other: "Parameter") -> bool:
        """Whether both are of one family at one joint: one cause, and the shape of its law."""
        family = self.kind.family
        return family is not None and family == other.kind.family and self.joint == other.joint

    @property
    def lowest(self) -> float:
        """Smallest u as an effect."""
        return -self.most if self.kind.either_sign else -self.in_file * self.kind.breaks

    @property
    def is_unsaid(self) -> bool:
        """Whether no file says it of any joint: beside a larger cause it is none."""
        return self.joint is None and self.kind.unsaid

    @property
    def is_tilt(self) -> bool:
        """Whether it turns gravity for all joints at once."""
        return not issubclass(self.kind, NumberEffect)


def parameters(
    catalogue: Catalogue,
    evidence: Evidence,
    uncertainty: float,
    everyday: float,
    guesses: Mapping[tuple[str, str], float] | None = None,
) -> tuple[Parameter, ...]:
    """All parameters of a limb, in the order of `every_effect`.

    Effects that are not in `catalogue` are tolerances still: what is not looked for is there.
    `uncertainty`: one standard deviation of the nominal numbers, relative, and `guesses` that of
    some of them by joint and number; `everyday`: the share of the other tolerances that mechanisms
    of this origin have.
    """
    found, seen = list[Parameter](), (ripples(evidence.limb), blocked(evidence.limb))
    for name, kind in {**every_effect(), **catalogue, **TERMS}.items():
        joints = range(len(evidence.joints)) if kind.per_joint else (None,)
        own = []
        for place, joint in product(_places(kind), joints):
            where = "" if joint is None else evidence.joints[joint]
            sure = (guesses or {}).get((where, c.COLUMNS[place]), uncertainty)
            one = _parameter(name, kind, joint, place, evidence, sure, everyday)
            if one is not None:
                shows = not (evidence.only_rests and place in c.MOVING)
                one = replace(one, nameable=name in catalogue and shows)
                own.append(_as_seen(one, evidence.limb, *seen))
        found += own
        for number, one in enumerate(own, len(found) - len(own)):
            found += _spots(one, number, evidence)
        if kind.shared and len(evidence.joints) > 1 and own:
            least = max(one.least for one in own)
            found.append(replace(own[0], joint=None, tolerance=0.0, unit=1.0, least=least))
        if kind.unsaid and len(own) > 1:
            found += _unsaid(own, len(found), evidence)
    found += [_OWN_STEPS] * bool(evidence.own_steps.any())
    found += [_SOFT_FRICTION] * evidence.limb.rigid
    return tuple(found)


def _spots(one: Parameter, number: int, evidence: Evidence) -> Iterator[Parameter]:
    """Where an effect acts, on its link, joint or turn, as parameters of its law."""
    if one.joint is not None and one.nameable:
        reach_m = evidence.limb.spec.hand.driven[one.joint].reach_m
        units = {c.REST: TURNS * evidence.size[one.joint], c.ACROSS: ONCE_RAD}
        for name in one.kind.spot:
            place = c.COLUMNS.index(name)
            firm = place == c.FIRM
            yield replace(
                one,
                kind=_Stiffness if firm else _Spot,
                place=place,
                unit=units.get(place, reach_m),
                onset=0.0,
                beside=(),
                tolerance=GUESS if firm else SPOT,
                least=_Spot.least,
                most=_Spot.most,
                nameable=False,
                part_of=number,
            )


def _unsaid(own: Sequence[Parameter], number: int, evidence: Evidence) -> Iterator[Parameter]:
    """An effect that no joint has by its file: on all of them, and by how much they differ."""
    one = own[0]
    if evidence.limb.rigid and not evidence.limb.nominal[:, one.place].any():
        yield replace(one, joint=None, tolerance=0.0, unit=float(np.mean(evidence.torque)))
        for each in own:
            part = replace(each, kind=_Spot, tolerance=APART, nameable=False, part_of=number)
            yield replace(part, least=_Spot.least, most=_Spot.most)


def _as_seen(one: Parameter, limb: Limb, ripple: Array, stops: Sequence[Blocked]) -> Parameter:
    """A parameter with the shape of its law that the log shows before its size."""
    if one.joint is None:
        return one
    value = float(limb.nominal[one.joint, one.place])
    if one.place == c.COGGING and value == 0.0:
        return replace(one, beside=tuple(zip((c.PERIOD, c.PHASE), ripple[one.joint], strict=True)))
    if one.kind.coordinate == "reach":
        stop, teeth = stops[one.joint], float(limb.nominal[one.joint, c.STIFFNESS])
        firm = stop.stiffness_nm_rad or FIRM * float(limb.servo[0, one.joint])
        firm = firm if limb.rigid else min(firm, teeth)
        return replace(
            one,
            unit=stop.side,
            onset=stop.side * stop.inside_rad - value,
            beside=((c.FIRM, firm),),
            nameable=one.nameable and stop.short_rad > one.least,
        )
    return one


_OWN_STEPS = Parameter(
    effect="simulator-steps",
    kind=_OwnSteps,
    joint=None,
    place=c.OWN_STEPS,
    unit=1.0,
    tolerance=OWN,
    least=1.0,
    most=1.0,
    nameable=False,
)
_SOFT_FRICTION = replace(
    _OWN_STEPS, effect="soft-friction", kind=_SoftFriction, place=c.SOFT, tolerance=0.0, least=0.5
)


def _places(kind: type[Effect]) -> tuple[int, ...]:
    if kind.least is None:
        return ()
    if not issubclass(kind, NumberEffect):
        return tuple(range(len(AXES)))
    return (c.COLUMNS.index(kind.number),) if kind.number in c.COLUMNS else ()


def _parameter(
    name: str,
    kind: type[Effect],
    joint: int | None,
    place: int,
    evidence: Evidence,
    uncertainty: float,
    everyday: float,
) -> Parameter | None:
    assert kind.least is not None
    about = partial(Parameter, effect=name, kind=kind, joint=joint, place=place)
    if joint is None:
        most, own = kind.most, kind.tolerance * everyday
        return about(unit=1.0, tolerance=own, least=kind.least, most=most)
    limb = evidence.limb
    value, rigid = limb.nominal[joint, place], limb.rigid
    unused = rigid and c.COLUMNS[place].startswith("drive.gear_")
    if kind.coordinate == "logarithm" and (value <= 0.0 or unused):
        return None
    body = limb.spec.hand.driven[joint]
    if kind.refusal(body) is not None or (kind.is_of("body") and not body.mass_kg):
        return None
    unit, in_file, most = _sizes(kind, joint, place, evidence)
    angle = evidence.size[joint] if kind.dimension == "angle" else 1.0
    own = kind.tolerance * everyday * angle
    late = LATE_SHARE * limb.period_s if kind.dimension == "time" and own > 0.0 else 0.0
    tolerance = max(float(np.hypot(own, uncertainty * in_file)), late)
    # what nothing asks of a drive's limit may be missing, and changes nothing
    unasked = float(np.log(value / evidence.torque[joint])) if place == c.LIMIT else 0.0
    return about(
        unit=unit,
        tolerance=tolerance,
        in_file=in_file if kind.coordinate == "amount" else 0.0,
        least=max(kind.least * angle, 2.0 * tolerance),
        most=most + unasked,
    )


def _sizes(
    kind: type[Effect], joint: int, place: int, evidence: Evidence
) -> tuple[float, float, float]:
    """Of an effect's number: its natural size [SI], and what the file says and the largest one [u].

    Of a hand the largest is within the effect's bounds, which its drive law needs.
    """
    limb, most, high = evidence.limb, kind.most, kind.bounds[1]
    numbers, (stiffness, damping) = limb.nominal[joint], limb.servo[:, joint]
    bounded = not limb.rigid and kind.dimension != "inertia"
    if kind.coordinate == "logarithm":
        own = float(kind.nominal)
        return 1.0, own, min(most, float(np.log1p(high))) if bounded else most
    if kind.coordinate == "compliance":
        unit = float(1.0 / stiffness)
        return unit, 1.0 / numbers[place] / unit if kind.nominal and not limb.rigid else 0.0, most
    damped = damping + numbers[c.VISCOUS] or np.sqrt(stiffness * numbers[c.ROTOR])
    natural = {"torque": evidence.torque[joint], "damping": damped, "stiffness": stiffness}
    unit = float(natural.get(kind.dimension, 1.0))
    own = numbers[place] / unit if kind.nominal else 0.0
    return unit, own, min(most, high / unit) if bounded else most


def with_parts(parameters: Sequence[Parameter], numbers: Collection[int]) -> list[int]:
    """Parameters by number, and those that belong to their laws."""
    return [k for k, p in enumerate(parameters) if k in numbers or p.part_of in numbers]


def bounds(parameter: Parameter, freed: bool, reach: float) -> tuple[float, float]:
    """How far u may go: any size as an effect, else within `reach` standard deviations."""
    if freed:
        return parameter.lowest, parameter.most
    low, high = (parameter.centre + side * reach * parameter.tolerance for side in (-1, 1))
    below_zero = parameter.kind.either_sign or parameter.kind.coordinate == "logarithm"
    return max(low, -np.inf if below_zero else -parameter.in_file), max(high, 0.0)


def magnitude(parameter: Parameter, u: float, numbers: Array) -> float:
    """The effect's magnitude in SI units at u, beside a joint's nominal numbers."""
    kind = parameter.kind
    if kind.coordinate == "compliance":
        return u * parameter.unit * numbers[c.STIFFNESS]
    if kind.coordinate == "logarithm":
        share = float(np.expm1(u))
        return share if kind.dimension == "share" else share * numbers[parameter.place]
    return parameter.onset + u * parameter.unit
