"""Radius of the stick and softness of contacts, from how near tips and stick are.

A tip lies nearer to the stick's axis by what the contact yields, and further by what the stick is
thicker, whatever engine or robot it is:

    gap = extra radius - compliance force,   per finger and episode

where `gap` is the distance between the surfaces of tip and nominal stick, and forces are those of a
replay. Fingers bear unequal loads, which tells the two apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.verdict import UNKNOWN
from diagnosis.beside._regrasp import Shown, Simulate, regrasp
from diagnosis.beside.finding import Finding, confidence, share
from diagnosis.beside.held import Held, gaps_m

RADIUS, SOFTNESS = "stick-radius", "contact-softness"
SETTLED_S = 0.3
"""Gaps and forces are taken after this."""
FLOOR_M = 2.5e-5
"""Nominal worlds on three engines differ by this in the intercept: 0, -0.010 and -0.022 mm."""
OWN_M_N = 0.08e-3
"""Yield of nominal contacts: 0.060 mm/N in MuJoCo with the reference stick, none in the others."""
SOFT_M_N = 0.03e-3
"""Smallest compliance that is worth a finding: MuJoCo's own changes by 0.02 with the mass."""
ODD_M, ODD_SHARE = 6e-5, 0.15
"""Fingers that disagree by more than this, and this share of what they yield, are misplaced."""
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


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """What the gaps say, and the world with it."""

    world: Spec
    findings: tuple[Finding, ...] = ()
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


def shapes(
    nominal: Spec,
    parts: Sequence[Held],
    catalogue: Mapping[str, type[Effect]],
    simulate: Simulate,
) -> Shapes:
    """The radius and softness that the gaps of these episodes show."""
    sought = [name for name in (RADIUS, SOFTNESS) if name in catalogue]
    real = np.array([_gap(nominal, p) for p in parts])
    world, own = nominal, None
    found: tuple[Finding, ...] = ()
    for _ in range(ROUNDS):
        shown = regrasp(simulate, [world], parts)[0]
        force = np.array([_middle(p, s.force_n) for p, s in zip(parts, shown, strict=True)])
        own = own or line(_played(nominal, parts, shown), force)
        seen = line(real, force)
        odd = ODD_M + ODD_SHARE * abs(seen.compliance_m_n) * float(force.mean())
        if seen.left_m > odd:
            why = MISPLACED.format(1e3 * seen.left_m)
            return Shapes(world=nominal, missing=(f"{', '.join(sought)}: {why}",) if sought else ())
        found = _findings(nominal, seen, own, sought, float(force.mean()))
        world = nominal
        for one in found:
            if one.effect in catalogue:
                world = catalogue[one.effect](magnitude=one.value).on_spec(world)
        world = _stiffened(world, seen, own)
    return Shapes(world=world, findings=found)


def _stiffened(world: Spec, seen: Line, own: Line) -> Spec:
    """The world with harder contacts where the gaps show less yield than its own.

    A soft contact yields as the square of its time constant; drive periods end that.
    """
    shrink = max(seen.compliance_m_n, 0.0) / max(own.compliance_m_n, 1e-9)
    if shrink >= 1.0 or own.compliance_m_n < SOFT_M_N:
        return world
    time_s = world.contact.time_constant_s * float(np.sqrt(shrink))
    contact = replace(world.contact, time_constant_s=max(time_s, 2 * world.timing.drive_s))
    return replace(world, contact=contact)


def _middle(part: Held, values: Array) -> Array:
    """Medians over an episode once the grip has settled."""
    return np.median(values[part.time_s >= SETTLED_S], axis=0)


def _gap(nominal: Spec, part: Held) -> Array:
    return _middle(part, gaps_m(nominal, part))


def _played(nominal: Spec, parts: Sequence[Held], shown: Sequence[Shown]) -> Array:
    """Gaps of a replay, (E, F)."""
    pairs = zip(parts, shown, strict=True)
    return np.array(
        [_gap(nominal, replace(p, joint_rad=s.joint_rad, stick=s.stick)) for p, s in pairs]
    )


def _findings(
    nominal: Spec, seen: Line, own: Line, sought: Sequence[str], force_n: float
) -> tuple[Finding, ...]:
    radius_m, radius_std = seen.radius_m - own.radius_m, float(np.hypot(seen.std[0], FLOOR_M))
    soft, soft_std = seen.compliance_m_n - own.compliance_m_n, seen.std[1]
    worth = max(SOFT_M_N, OWN_M_N - own.compliance_m_n)
    odds = radius_m / radius_std, soft / max(soft_std, SOFT_M_N / SURE_Z)
    before = float(np.sqrt(1 + (radius_m / FLOOR_M) ** 2 + (max(soft, 0) * force_n / FLOOR_M) ** 2))
    after = float(np.sqrt(1 + (seen.left_m / FLOOR_M) ** 2))

    def finding(
        effect: str, value: float, ends: tuple[float, float], z: float, text: str
    ) -> Finding:
        known = effect in sought
        return Finding(
            effect=effect if known else UNKNOWN,
            joint=None,
            value=value if known else 0.0,
            interval=ends if known else (0.0, 0.0),
            share=share(before, after) if known else 0.0,
            gap_before=before,
            gap_after=after if known else before,
            confidence=confidence(z**2 / 2),
            ties=("encoder-bias",) if effect == RADIUS else (),
            evidence=text,
        )

    found = []
    if abs(odds[0]) >= SURE_Z:
        size, width = radius_m / nominal.stick.radius_m, radius_std / nominal.stick.radius_m
        text = f"tips touch {1e3 * radius_m:+.2f} mm from where the nominal stick's surface is"
        ends = size - Z90 * width, size + Z90 * width
        found.append(finding(RADIUS, size, ends, odds[0], text))
    if soft >= worth and odds[1] >= SURE_Z:
        text = f"tips sink into the stick by {1e3 * seen.compliance_m_n:.2f} mm/N"
        ends = soft - Z90 * soft_std, seen.compliance_m_n + Z90 * soft_std
        found.append(finding(SOFTNESS, soft, ends, odds[1], text))
    return tuple(found)
