"""Radius of the stick and softness of contacts, from how near tips and stick are.

A tip lies nearer to the stick's axis by what the contact yields, and further by what the stick is
thicker, whatever engine or robot it is:

    gap = extra radius - compliance force - own yield,   per finger and episode

where `gap` is the distance between the surfaces of tip and nominal stick, and forces are those of a
replay. Fingers bear unequal loads, which tells the two apart. Contacts of the nominal engine yield
somewhat by themselves, which those of another engine or robot may not: both are tried, and the one
that needs fewer effects is believed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.verdict import UNKNOWN
from diagnosis.beside._regrasp import Simulate, regrasp
from diagnosis.beside.finding import STICK, Finding, Spot, share
from diagnosis.beside.held import Held, gaps_m

RADIUS, SOFTNESS = "stick-radius", "contact-softness"
SETTLED_S = 0.3
"""Gaps and forces are taken after this."""
FLOOR_M = 2.5e-5
"""Nominal worlds on Bullet and SAPIEN differ from rigid contacts by 0.010 mm."""
SOFT_M_N = 0.03e-3
"""Smallest compliance that is worth a finding: MuJoCo's own changes by 0.02 with the mass."""
ODD_M, ODD_SHARE = 6e-5, 0.15
"""Fingers that disagree by more than this, and this share of what they yield, are misplaced."""
FORCE_SHARE = 0.05
"""Forces are those of a replay, whose drives are known no better."""
ROUNDS = 3
"""A softer or thicker world squeezes with another force: replays with what was found so far."""
Z90, SURE_Z = 1.645, 3.0
MISPLACED = (
    "not identifiable from this log: fingers and stick disagree by {:.2f} mm; mend joint zeros"
)


@dataclass(frozen=True, kw_only=True)
class Line:
    """Gaps as a line over forces."""

    radius_m: float
    """Intercept: extra radius."""
    compliance_m_n: float
    std: tuple[float, float]
    """Of both."""
    left_m: float
    """Root mean square of what it does not explain."""

    @property
    def odds(self) -> tuple[float, float]:
        """Standard deviations by which radius and compliance are something."""
        soft_std = max(self.std[1], SOFT_M_N / SURE_Z)
        return self.radius_m / float(np.hypot(self.std[0], FLOOR_M)), self.compliance_m_n / soft_std

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that it asks for."""
        thick, soft = abs(self.odds[0]) >= SURE_Z, self.odds[1] >= SURE_Z
        return (RADIUS,) * thick + (SOFTNESS,) * (soft and self.compliance_m_n >= SOFT_M_N)

    @property
    def price(self) -> tuple[int, float]:
        """What speaks against it: effects, one more where contacts push out, and what is left."""
        return len(self.effects) + (self.odds[1] <= -SURE_Z), self.left_m


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """What the gaps say, and the world with it."""

    world: Spec
    findings: tuple[Finding, ...] = ()
    spots: tuple[Spot, ...] = ()
    missing: tuple[str, ...] = ()


def line(gap_m: Array, force_n: Array) -> Line:
    """The least-squares line through gaps and forces, both (E, F)."""
    gap, force = gap_m.ravel(), force_n.ravel()
    design = np.stack([np.ones_like(force), -force], axis=1)
    (radius, compliance), *_ = np.linalg.lstsq(design, gap, rcond=None)
    left = gap - design @ (radius, compliance)
    variance = float(left @ left) / max(len(gap) - 2, 1)
    spread = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * variance)
    return Line(
        radius_m=float(radius),
        compliance_m_n=float(compliance),
        std=(float(spread[0]), float(spread[1])),
        left_m=float(np.sqrt(np.mean(left**2))),
    )


@dataclass(frozen=True, kw_only=True)
class Seen:
    """The better of two readings of the gaps, and what it is about."""

    line: Line
    rigid: bool
    """Whether contacts yield by nothing but the line, or by the nominal engine's own as well."""
    gap_m: Array
    """Gaps without the engine's own, shape (E, F)."""
    force_n: Array
    """Shape (E, F)."""
    soft_m_n: tuple[float, float]
    """Compliance with the engine's own taken off in full, and not at all."""


def shapes(
    nominal: Spec,
    parts: Sequence[Held],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
) -> Shapes:
    """The radius and softness that the gaps of these episodes show."""
    sought = [name for name in (RADIUS, SOFTNESS) if name in catalogue]
    real = np.array([_gap(nominal, p) for p in parts])
    force, own = _replayed(nominal, nominal, parts, simulate)
    for _ in range(ROUNDS):
        seen = _seen(real, own, force)
        left_m = seen.line.left_m
        if left_m > ODD_M + ODD_SHARE * abs(seen.line.compliance_m_n) * float(force.mean()):
            why = f"{', '.join(sought)}: {MISPLACED.format(1e3 * left_m)}"
            return Shapes(world=nominal, missing=(why,) if sought else ())
        world = _with(_stiff(nominal) if seen.rigid else nominal, seen)
        force, _ = _replayed(world, nominal, parts, simulate)
    return Shapes(
        world=world, findings=_findings(nominal, seen, sought), spots=_spots(nominal, seen)
    )


def _with(world: Spec, seen: Seen) -> Spec:
    """The world with what a line asks for, whether or not the catalogue has a name for it."""
    stick, contact = world.stick, world.contact
    if RADIUS in seen.line.effects:
        stick = replace(stick, radius_m=stick.radius_m + seen.line.radius_m)
    if SOFTNESS in seen.line.effects:
        softer_m_n = contact.compliance_m_n + float(np.mean(seen.soft_m_n))
        contact = replace(contact, compliance_m_n=softer_m_n)
    return replace(world, stick=stick, contact=contact)


def _replayed(
    world: Spec, nominal: Spec, parts: Sequence[Held], simulate: Simulate
) -> tuple[Array, Array]:
    """Forces and gaps to the nominal stick in a replay of a world, both (E, F)."""
    shown = regrasp(simulate, [world], parts)[0]
    pairs = list(zip(parts, shown, strict=True))
    force = np.array([_middle(p, s.force_n) for p, s in pairs])
    played = [replace(p, joint_rad=s.joint_rad, stick=s.stick) for p, s in pairs]
    return force, np.array([_gap(nominal, p) for p in played])


def _seen(real: Array, own: Array, force: Array) -> Seen:
    rigid, yielding = line(real, force), line(real - own, force)
    own_m_n = float(np.median(-own / force))
    stiff = rigid.price < yielding.price
    best = rigid if stiff else yielding
    total_m_n = best.compliance_m_n + (0.0 if stiff else own_m_n)
    return Seen(
        line=best,
        rigid=stiff,
        gap_m=real if stiff else real - own,
        force_n=force,
        soft_m_n=(total_m_n - own_m_n, total_m_n),
    )


def _spots(nominal: Spec, seen: Seen) -> tuple[Spot, ...]:
    """Gaps at every finger before and after the effects of a line."""
    thick, soft = (name in seen.line.effects for name in (RADIUS, SOFTNESS))
    yielded = soft * seen.line.compliance_m_n * seen.force_n
    left_m = seen.gap_m - thick * seen.line.radius_m + yielded
    sizes = (np.sqrt(1 + np.mean((v / FLOOR_M) ** 2, axis=0)) for v in (seen.gap_m, left_m))
    return tuple(
        Spot(finger=tip.finger, family=STICK, gap_before=float(before), gap_after=float(after))
        for tip, before, after in zip(nominal.hand.fingertips, *sizes, strict=True)
    )


def _stiff(world: Spec) -> Spec:
    """The world with contacts as hard as its drive period allows."""
    contact = replace(world.contact, time_constant_s=2 * world.timing.drive_s)
    return replace(world, contact=contact)


def _middle(part: Held, values: Array) -> Array:
    """Medians over an episode once the grip has settled."""
    return np.median(values[part.time_s >= SETTLED_S], axis=0)


def _gap(nominal: Spec, part: Held) -> Array:
    return _middle(part, gaps_m(nominal, part))


def _findings(nominal: Spec, seen: Seen, sought: Sequence[str]) -> tuple[Finding, ...]:
    """The effects that a line asks for; `unknown` where one is not in the catalogue."""
    before = float(np.sqrt(1 + np.mean((seen.gap_m / FLOOR_M) ** 2)))
    after = float(np.sqrt(1 + (seen.line.left_m / FLOOR_M) ** 2))
    odds = dict(zip((RADIUS, SOFTNESS), seen.line.odds, strict=True))
    sizes = {RADIUS: _radius(nominal, seen.line), SOFTNESS: _softness(seen)}
    return tuple(
        _finding(name if name in sought else UNKNOWN, *sizes[name], odds[name], before, after)
        for name in seen.line.effects
    )


def _radius(nominal: Spec, seen: Line) -> tuple[float, float, str]:
    """Relative change of the radius, half of its interval, and what says so."""
    half = Z90 * float(np.hypot(seen.std[0], FLOOR_M)) / nominal.stick.radius_m
    text = (
        f"tips touch {1e3 * seen.radius_m:+.2f} mm from where the nominal stick's surface is; so "
        "would they if all joint zeros were off alike"
    )
    return seen.radius_m / nominal.stick.radius_m, half, text


def _softness(seen: Seen) -> tuple[float, float, str]:
    """The compliance, half of its interval, and what says so."""
    low, high = seen.soft_m_n
    text = (
        f"tips sink into the stick by {1e3 * high:.2f} mm/N, of which the nominal contact may "
        f"make {1e3 * (high - low):.2f}"
    )
    half = (high - low) / 2 + Z90 * float(np.hypot(seen.line.std[1], FORCE_SHARE * high))
    return (low + high) / 2, half, text


def _finding(
    effect: str, value: float, half: float, text: str, z: float, before: float, after: float
) -> Finding:
    known = effect != UNKNOWN
    return Finding(
        effect=effect,
        joint=None,
        family=STICK,
        value=value if known else 0.0,
        interval=(value - half, value + half) if known else (0.0, 0.0),
        share=share(before, after) if known else 0.0,
        gap_before=before,
        gap_after=after if known else before,
        lead_nats=float(z**2 / 2),
        evidence=text,
    )
