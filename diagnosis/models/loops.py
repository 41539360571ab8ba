"""What drives may do that no file of a log says: terms of their loops, alike on all joints.

They are no faults. A search takes them among its causes, so that no fault is named in their place;
what it finds of them is to be looked up.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

from backends.effect import NumberEffect
from diagnosis.evidence.evidence import Evidence
from diagnosis.models.parameters import Parameter, with_parts
from diagnosis.models.world import World
from diagnosis.motion import columns as c


class Term(NumberEffect):
    """A number of a loop, under its name in log.yaml."""

    name: ClassVar[str]
    words: ClassVar[str]
    """What a drive with it has."""
    least: ClassVar[float]
    dimension, unit = "share", "%"
    kinked = True


class Integral(Term):
    """An integral in all drives, as a share of kp [1/s]."""

    number, name, words = "loop.integral_hz", "ki", "an integral"
    least, most = 0.1, 50.0


class SpeedIntegral(Term):
    """An integral on the speed in all drives, by one over its reset time [1/s]."""

    number, name = "loop.speed_integral_hz", "speed_integral"
    words = "an integral on the speed, as in a cascade,"
    least, most = 0.1, 200.0


class Filter(Term):
    """A filter on the speed that all drives take, by its time constant [s]."""

    number, name, words = "loop.filter_s", "filter", "a filter on the speed"
    least, most = 1e-3, 0.2


class Lag(Term):
    """A torque of all drives that lags, by its time constant [s]."""

    number, name, words = "loop.lag_s", "lag", "a torque that lags"
    least, most = 5e-4, 0.2


class Lead(Term):
    """The share of the target's speed that kd follows in all drives."""

    number, name, words = "loop.lead", "lead", "kd on the error of the speed"
    least, most = 0.05, 1.0


class IntegralLimit(Term):
    """The largest torque of an integral [Nm]."""

    number, name = "loop.integral_limit_nm", "integral_limit"
    least, most = 0.05, 1.0


TERMS: tuple[type[Term], ...] = (Integral, SpeedIntegral, Filter, Lag, Lead)
BEGUN, HELD = 0.25, 0.38
"""Where the limit of an integral is sought from, and its standard deviation, as shares of the
drive's."""
LEAST = 0.95
"""It may be less than there by this share."""


def terms(evidence: Evidence, first: int) -> Iterator[Parameter]:
    """Terms that no drive of a limb has by its files, as its parameters from number `first` on.

    The integral of a single joint may have a limit of its own.
    """
    limb, number = evidence.limb, first
    if not limb.rigid or limb.open.any() or evidence.only_rests:
        return
    for kind in TERMS:
        one = _term(kind)
        if limb.nominal[:, one.place].any():
            continue
        if kind in (Integral, SpeedIntegral) and len(limb.joints) == 1:
            limit = float(limb.nominal[0, c.LIMIT])
            yield replace(one, beside=((c.FULL, BEGUN * limit),))
            yield replace(
                _term(IntegralLimit),
                unit=limit,
                tolerance=HELD,
                in_file=LEAST * BEGUN,
                nameable=False,
                part_of=number,
            )
            number += 1
        else:
            yield one
        number += 1


def _term(kind: type[Term]) -> Parameter:
    return Parameter(
        effect=kind.name,
        kind=kind,
        joint=None,
        place=c.COLUMNS.index(kind.number),
        unit=1.0,
        tolerance=0.0,
        least=kind.least,
        most=kind.most,
    )


def is_term(parameter: Parameter) -> bool:
    """Whether it is a term of drives, and no effect."""
    return issubclass(parameter.kind, Term)


def said(world: World, u: Mapping[int, float]) -> str:
    """The terms at u (by number) in words, and as log.yaml has them; empty where there are none."""
    found, (first, *others) = list[str](), world.evidence.joints
    numbers = world.numbers(u)[0][0]
    for number, one in enumerate(world.parameters):
        if issubclass(one.kind, Term) and one.part_of is None and u.get(number):
            own = (world.parameters[k] for k in with_parts(world.parameters, [number]))
            sizes = {p.kind.name: float(numbers[p.place]) for p in own if issubclass(p.kind, Term)}
            if not others and "ki" in sizes:
                sizes["ki"] *= float(numbers[c.KP])
            of = {"ki": " kp"} if others else {}
            terms = ", ".join(f"{k}: {size:.3g}{of.get(k, '')}" for k, size in sizes.items())
            where = "all drives" if others else f"the drive of {first}"
            found.append(f"{one.kind.words} in {where} (`{terms}`)")
    return " and ".join(found)
