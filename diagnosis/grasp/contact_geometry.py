"""Radius of the stick and softness of contacts, from how near tips and stick are.

A tip lies nearer to the stick's axis by what the contact yields, and further by what the stick is
thicker, whatever engine or robot it is:

    gap = extra radius - compliance force - own yield,   per finger and episode

where `gap` is the distance between the surfaces of tip and nominal stick, and forces are those of a
replay. Fingers bear unequal loads, which tells the two apart. Contacts of the nominal engine yield
somewhat by themselves, which those of another engine or robot may not: both are tried, and the one
that needs fewer effects is used. Where a replay of one moves as the log does, the log is from the
nominal engine: that decides where they need as many, and what of a softness is its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import linregress

from backends.catalogue import of_part
from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.grasp.grasp_likelihood import judged
from diagnosis.grasp.simulate_grasps import Simulate, simulate_grasps
from diagnosis.motion.held import FLOOR_M, Held, gaps_m
from diagnosis.verdict.in_hand import STICK, Report, Spot, missing
from diagnosis.verdict.result import UNKNOWN, Z90, Cause, cause

RADIUS, SOFTNESS = "stick.radius_m", "contact.compliance_m_n"
SETTLED_S = 0.3
"""Gaps and forces are taken after this."""
SOFT_M_N = 0.03e-3
"""Smallest compliance that is worth a finding: MuJoCo's own changes by 0.02 with the mass."""
ODD_M, ODD_SHARE = 6e-5, 0.15
"""Fingers that disagree by more than this, and this share of what they yield, are misplaced."""
FORCE_SHARE = 0.05
"""Forces are those of a replay, whose drives are known no better."""
GIVEN_M_N = 0.1e-3
"""Softness that tells what contacts yield beside one."""
OWN = 0.3
"""A replay on the nominal engine is this near where the log is from it; of others no replay comes
nearer than 0.35, see `judged`."""
CURVED, NOISE_M = 2.0, 7e-6
"""Gaps are no line where they leave so many times what another reading does, and that is more than
what a tracker makes of medians."""
FIRM = 1.15
"""Contacts that seem to yield by nothing of their own do so in gaps as well: these are as much of a
line, or nearly."""
ROUNDS = 3
"""A softer or thicker world squeezes with another force: replays with what was found so far."""
SURE_Z = 3.0
MISPLACED = (
    "not identifiable from this log: fingers and stick disagree by {:.2f} mm; correct joint zeros"
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
    def asks(self) -> int:
        """What speaks against it: effects, one more where contacts push out."""
        return len(self.effects) + (self.odds[1] <= -SURE_Z)


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """What the gaps say."""

    report: Report
    soft: bool = False
    """Whether contacts are softer than given."""

    @property
    def world(self) -> Spec:
        """The world with it."""
        assert self.report.world is not None
        return self.report.world


def line(gap_m: Array, force_n: Array) -> Line:
    """The least-squares line through gaps and forces, both (E, F)."""
    gap, force = gap_m.ravel(), force_n.ravel()
    fit = linregress(force, gap)
    left = gap - fit.intercept - fit.slope * force
    return Line(
        radius_m=float(fit.intercept),
        compliance_m_n=-float(fit.slope),
        std=(float(fit.intercept_stderr), float(fit.stderr)),
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
    is_own: bool = False
    """Whether the log moves as the nominal engine does."""

    @property
    def hard(self) -> bool:
        """Whether contacts are taken to yield by nothing but the line."""
        return self.rigid and not self.is_own

    @property
    def compliance_m_n(self) -> float:
        """Compliance beyond what contacts yield by themselves, which may be less than it was."""
        return self.soft_m_n[self.hard or self.soft_m_n[0] <= 0]

    @property
    def firm(self) -> "Seen":
        """This, of contacts that are known to yield by nothing of their own."""
        return replace(self, soft_m_n=(self.line.compliance_m_n, self.line.compliance_m_n))


def shapes(
    nominal: Spec,
    parts: Sequence[Held],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
    firm: bool = False,
) -> Shapes:
    """The radius and softness that the gaps of these episodes show.

    `firm`: the log's contacts are known to yield by nothing of their own.
    """
    names = of_part(catalogue, "stick", "contact")
    real = np.array([_gap(nominal, p) for p in parts])
    force, own = _replayed(nominal, nominal, parts, simulate)
    own_m_n = _own_m_n(nominal, parts, simulate)
    is_own = False
    for _ in range(ROUNDS):
        readings = _readings(real, own, force, own_m_n)
        rigid, yielding = readings
        if firm and rigid.line.left_m < FIRM * yielding.line.left_m:
            seen = rigid.firm
        else:
            is_own = is_own or _is_own(nominal, readings, parts, simulate)
            seen = _better(readings, is_own)
        left_m = seen.line.left_m
        if left_m > ODD_M + ODD_SHARE * abs(seen.line.compliance_m_n) * float(force.mean()):
            sought = [names[number] for number in (RADIUS, SOFTNESS) if number in names]
            why = missing(sought, MISPLACED.format(1e3 * left_m))
            return Shapes(report=Report(missing=why, world=nominal))
        world = _with(nominal, seen)
        force, _ = _replayed(world, nominal, parts, simulate)
    return Shapes(
        report=Report(
            causes=_causes(nominal, seen, names, catalogue),
            spots=_spots(nominal, seen),
            world=world,
        ),
        soft=SOFTNESS in seen.line.effects,
    )


def _with(world: Spec, seen: Seen) -> Spec:
    """The world with what a line asks for, whether or not the catalogue has a name for it."""
    stick, contact = world.stick, _stiff(world).contact if seen.hard else world.contact
    if RADIUS in seen.line.effects:
        stick = replace(stick, radius_m=stick.radius_m + seen.line.radius_m)
    if SOFTNESS in seen.line.effects:
        softer_m_n = max(contact.compliance_m_n + seen.compliance_m_n, 0.0)
        contact = replace(contact, compliance_m_n=softer_m_n)
    return replace(world, stick=stick, contact=contact)


def _replayed(
    world: Spec, nominal: Spec, parts: Sequence[Held], simulate: Simulate
) -> tuple[Array, Array]:
    """Forces and gaps to the nominal stick in a replay of a world, both (E, F)."""
    shown = simulate_grasps(simulate, [world], parts)[0]
    pairs = list(zip(parts, shown, strict=True))
    force = np.array([_middle(p, s.force_n) for p, s in pairs])
    played = [replace(p, joint_rad=s.joint_rad, stick=s.stick) for p, s in pairs]
    return force, np.array([_gap(nominal, p) for p in played])


def _own_m_n(nominal: Spec, parts: Sequence[Held], simulate: Simulate) -> float:
    """What contacts that are given a softness yield beside it: by a line, as not all do without."""
    contact = replace(nominal.contact, compliance_m_n=nominal.contact.compliance_m_n + GIVEN_M_N)
    force, gap = _replayed(replace(nominal, contact=contact), nominal, parts, simulate)
    return float(np.median(-gap / force)) - GIVEN_M_N


def _readings(real: Array, own: Array, force: Array, own_m_n: float) -> tuple[Seen, Seen]:
    """The gaps as of contacts that yield by nothing but the line, and as the nominal engine's do.

    `own`: gaps that the nominal engine leaves by itself; beside a softness `own_m_n` of the force.
    """
    rigid, yielding = line(real, force), line(real - own, force)
    bare_m_n = float(np.median(-own / force))
    return (
        Seen(
            line=rigid,
            rigid=True,
            gap_m=real,
            force_n=force,
            soft_m_n=(rigid.compliance_m_n - own_m_n, rigid.compliance_m_n),
        ),
        Seen(
            line=yielding,
            rigid=False,
            gap_m=real - own,
            force_n=force,
            soft_m_n=(
                yielding.compliance_m_n + bare_m_n - own_m_n,
                yielding.compliance_m_n + bare_m_n,
            ),
        ),
    )


def _better(readings: tuple[Seen, Seen], is_own: bool) -> Seen:
    """The reading that asks for fewer effects; of two that ask alike the nominal engine's own way.

    A softness of other engines' contacts may look as a radius does beside the nominal engine's, and
    how the stick moves tells which engine it was. Unless that leaves far more or is a softness:
    beside one, contacts of the nominal engine yield by a line as well.
    """
    rigid, yielding = (replace(seen, is_own=is_own) for seen in readings)
    if rigid.line.asks == yielding.line.asks:
        curved = yielding.line.left_m > CURVED * max(rigid.line.left_m, NOISE_M)
        return rigid if not is_own or curved or SOFTNESS in yielding.line.effects else yielding
    return rigid if rigid.line.asks < yielding.line.asks else yielding


def _is_own(
    nominal: Spec, readings: tuple[Seen, Seen], parts: Sequence[Held], simulate: Simulate
) -> bool:
    """Whether the log moves as the nominal engine does, in the world of one of its readings."""
    rigid, yielding = readings
    tried = (rigid, replace(rigid, is_own=True), yielding)
    worlds = [_with(nominal, seen) for seen in tried]
    return (
        min(judged(shown, parts, nominal)[1] for shown in simulate_grasps(simulate, worlds, parts))
        < OWN
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


def _causes(
    nominal: Spec, seen: Seen, names: Mapping[str, str], catalogue: Mapping[str, type[Effect]]
) -> tuple[Cause, ...]:
    """The effects that a line asks for; `unknown` where one is not in the catalogue."""
    before = float(np.sqrt(1 + np.mean((seen.gap_m / FLOOR_M) ** 2)))
    after = float(np.sqrt(1 + (seen.line.left_m / FLOOR_M) ** 2))
    sizes = {RADIUS: _radius(nominal, seen.line), SOFTNESS: _softness(seen)}
    return tuple(
        stick_cause(names.get(number, UNKNOWN), sizes[number], before, after, catalogue)
        for number in seen.line.effects
    )


Size = tuple[float, tuple[float, float], str]
"""A magnitude, its 90 % interval, and what says so."""


def _radius(nominal: Spec, seen: Line) -> Size:
    """Relative change of the radius."""
    value, std = seen.radius_m / nominal.stick.radius_m, np.hypot(seen.std[0], FLOOR_M)
    half = Z90 * float(std) / nominal.stick.radius_m
    text = (
        f"tips touch {1e3 * seen.radius_m:+.2f} mm from where the nominal stick's surface is; so "
        "would they if all joint zeros were off alike"
    )
    return value, (value - half, value + half), text


def _softness(seen: Seen) -> Size:
    """The compliance, as sure as it is known what contacts yield by themselves."""
    low, high = seen.soft_m_n
    text = (
        f"tips sink into the stick by {1e3 * high:.2f} mm/N, of which the nominal contact may "
        f"make {1e3 * (high - low):.2f}"
    )
    blur = Z90 * float(np.hypot(seen.line.std[1], FORCE_SHARE * high))
    return seen.compliance_m_n, (max(low - blur, 0.0), high + blur), text


def stick_cause(
    effect: str, size: Size, before: float, after: float, catalogue: Mapping[str, type[Effect]]
) -> Cause:
    """A cause about the stick; an unknown has no size."""
    value, interval, text = size
    if effect == UNKNOWN:
        return cause(UNKNOWN, (0.0, 0.0, 0.0), catalogue, evidence=text)
    sizes = value, *interval
    return cause(effect, sizes, catalogue, share=share(before, after), evidence=text)


def share(before: float, after: float) -> float:
    """Share of the squared gap above the floor that is gone."""
    excess = before**2 - 1.0
    return float(np.clip(1 - max(after**2 - 1.0, 0.0) / excess, 0.0, 1.0)) if excess > 0 else 0.0
