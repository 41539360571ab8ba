"""Radius of the stick and softness of contacts, from how near tips and stick are.

A tip lies nearer to the stick's axis by what the contact yields, and further by what the stick is
thicker, whatever engine or robot it is:

    gap = extra radius - yield(force),   per finger and episode

where `gap` is the distance between the surfaces of tip and nominal stick, and forces are those of a
replay. Contacts are of two kinds: rigid ones yield by softness times force and nothing else, those
of the nominal engine as a replay does. Every subset of the two numbers is fitted with both kinds,
and the smallest is named that takes its share of the squared gap and leaves what is ordinary. The
nominal engine's contacts come first where a replay moves as the log does, and last where none does.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from backends.catalogue import Catalogue, of_part
from backends.spec import Spec
from backends.state import Array
from diagnosis.grasp.forward_model import (
    MASS,
    RADIUS,
    SOFTNESS,
    motion_gap,
    settled,
    simulate_grasps,
)
from diagnosis.motion.batch import Simulate
from diagnosis.motion.held import FLOOR_M, Held, gaps_m
from diagnosis.verdict.ordinary import SIMULATORS, Gap, is_named, is_worth, share_of
from diagnosis.verdict.result import STICK, UNKNOWN, Z90, Cause, Report, Spot, cause, missing

SUBSETS = ((), (RADIUS,), (SOFTNESS,), (RADIUS, SOFTNESS))
NUMBERS = (RADIUS, SOFTNESS, MASS)
PROBE, HEAVIEST = 0.2, 2.0
"""Logarithms of a mass: a step for its slope, and the most that it is off."""
MOST = np.array([-np.inf, -np.inf, -HEAVIEST]), np.array([np.inf, np.inf, HEAVIEST])
LEAST_M_N = 0.03e-3
"""Smallest compliance that is worth a name: MuJoCo's own changes by 0.02 with the mass."""
GIVEN = np.array([0.0, 0.1e-3, 0.0])
"""A fit begins with this softness: contacts that have one yield otherwise than those without."""
FORCE_SHARE = 0.05
"""Forces are those of a replay, whose drives are known no better."""
OWN = 0.3
"""A replay on the nominal engine is this near where the log is from it; of others no replay comes
nearer than 0.35, see `Fit.moved`."""
ROUNDS = 3
"""A softer or thicker world squeezes with another force: replays with what was found so far."""
MISPLACED = (
    "not identifiable from this log: fingers and stick disagree by {:.2f} mm; correct joint zeros"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Gap):
    """A subset of the two numbers, fitted to the gaps of a log with one kind of contacts."""

    numbers: tuple[str, ...]
    rigid: bool
    gap2: Array = field(default_factory=lambda: np.full(1, np.inf))
    by_finger: Array = field(default_factory=lambda: np.zeros(0))
    """The gaps that it leaves at fingers [floors], shape (F,)."""
    sizes: Array = field(default_factory=lambda: np.zeros(3))
    """`NUMBERS` beyond the nominal ones [m, m/N], the mass as the logarithm of a ratio: contacts of
    the nominal engine yield by it, so it is free beside them, and never named by gaps."""
    std: Array = field(default_factory=lambda: np.zeros(3))
    """Of these, by their scatter."""
    moved: float = np.inf
    """How far its replay moves from the log, over `ENGINES`."""

    @property
    def is_soft(self) -> bool:
        """Whether contacts are softer than nominal."""
        return SOFTNESS in self.numbers

    def on(self, nominal: Spec) -> Spec:
        """The world that it stands for; rigid contacts are as hard as its drive period allows."""
        stick, contact = nominal.stick, nominal.contact
        radius_m, compliance_m_n, mass = map(float, self.sizes)
        if self.rigid:
            contact = replace(contact, time_constant_s=2 * nominal.timing.drive_s)
        soft_m_n = max(contact.compliance_m_n + compliance_m_n, 0.0)
        stick = replace(
            stick,
            radius_m=max(stick.radius_m + radius_m, FLOOR_M),
            mass_kg=stick.mass_kg * float(np.exp(mass)),
        )
        return replace(nominal, stick=stick, contact=replace(contact, compliance_m_n=soft_m_n))

    def closer(
        self, nominal: Spec, parts: Sequence[Held], shown: Sequence[Held], heavier: Sequence[Held]
    ) -> "Fit":
        """The next least-squares step, from replays of its world and of one with more mass."""
        real, model, other = (
            np.array([settled(one, gaps_m(nominal, one)) for one in some])
            for some in (parts, shown, heavier)
        )
        force = np.array([settled(one, one.force_n) for one in shown])
        by_mass = (other - model) / PROBE
        slopes = np.stack([np.ones(force.size), -force.ravel(), by_mass.ravel()], axis=1)
        left = (real - model).ravel()
        if self.rigid:
            left = real.ravel() - slopes[:, :2] @ self.sizes[:2]
        free = np.isin(NUMBERS, self.numbers)
        inverse = np.linalg.pinv(slopes * free)
        step = inverse @ left
        left = left - slopes @ step
        scatter = np.sqrt(left @ left / max(left.size - sum(free), 1))
        floors = left.reshape(real.shape) / FLOOR_M
        pairs = zip(parts, shown, strict=True)
        gaps = [motion_gap(*pair, nominal.stick.length_m) for pair in pairs]
        return replace(
            self,
            gap2=np.array([np.mean(floors**2)]),
            by_finger=np.sqrt(np.mean(floors**2, axis=0)),
            sizes=np.clip(self.sizes + step, *MOST),
            std=scatter * np.linalg.norm(inverse, axis=1),
            moved=float(np.sqrt(np.mean(gaps))),
        )


@dataclass(frozen=True, kw_only=True)
class Shape:
    """What the gaps of a log say of radius and softness."""

    nominal: Fit
    """Without any number, with the kind of contacts that was chosen."""
    chosen: Fit
    alike: tuple[Fit, ...]
    """Fits of the same numbers that explain the gaps as well, the chosen one among them."""
    apart_m: float = 0.0
    """What is left where nothing explains them."""

    def on(self, nominal: Spec) -> Spec:
        """The world with what was found, whether or not the catalogue has a name for it."""
        return replace(self.chosen, sizes=self.chosen.sizes * (1.0, 1.0, 0.0)).on(nominal)

    def report(self, nominal: Spec, catalogue: Catalogue) -> Report:
        """What is named, `unknown` where it is not in the catalogue."""
        names = of_part(catalogue, "stick", "contact")
        if self.apart_m:
            sought = [names[number] for number in (RADIUS, SOFTNESS) if number in names]
            return missing(sought, MISPLACED.format(1e3 * self.apart_m))
        gaps = (fit.by_finger.tolist() for fit in (self.nominal, self.chosen))
        return Report(
            causes=tuple(self._causes(nominal, names, catalogue)),
            spots=tuple(
                Spot(finger=tip.finger, family=STICK, gap_before=before, gap_after=after)
                for tip, before, after in zip(nominal.hand.fingertips, *gaps, strict=True)
            ),
            world=self.on(nominal),
        )

    def _causes(
        self, nominal: Spec, names: Mapping[str, str], catalogue: Catalogue
    ) -> Iterator[Cause]:
        share = share_of(self.chosen, self.nominal)
        radius_m, compliance_m_n, _ = self.chosen.sizes
        # forces are those of a replay; a radius is stated as a share
        floors = FLOOR_M, FORCE_SHARE * compliance_m_n
        units = nominal.stick.radius_m, 1.0
        texts = (
            f"tips touch {1e3 * radius_m:+.2f} mm from where the nominal stick's surface is; so "
            "would they if all joint zeros were off alike",
            f"tips sink into the stick by {1e3 * compliance_m_n:.2f} mm/N more than at nominal "
            "contacts",
        )
        for k, number in enumerate(NUMBERS[:2]):
            if number in self.chosen.numbers:
                half = Z90 * float(np.hypot(self.chosen.std[k], floors[k]))
                ends = [fit.sizes[k] for fit in self.alike]
                low = min(ends) - half if number == RADIUS else max(min(ends) - half, 0.0)
                sizes = [v / units[k] for v in (self.chosen.sizes[k], low, max(ends) + half)]
                effect = names.get(number, UNKNOWN)
                yield cause(effect, sizes, catalogue, share=share, evidence=texts[k])


def shape(nominal: Spec, parts: Sequence[Held], simulate: Simulate) -> Shape:
    """The radius and softness that the gaps of these episodes show."""
    every = fits(nominal, parts, simulate)
    bare = {fit.rigid: fit for fit in every if not fit.numbers}
    explaining = [fit for fit in every if _explains(fit, bare[fit.rigid])]
    if not explaining:
        best = min(every, key=lambda fit: fit.worst)
        none = bare[best.rigid]
        return Shape(nominal=none, chosen=none, alike=(none,), apart_m=FLOOR_M * best.worst)
    known = [fit for fit in explaining if fit.rigid or fit.moved <= OWN] or explaining
    best = min(known, key=lambda fit: (len(fit.numbers), fit.rigid, fit.worst))
    for more in (fit for fit in explaining if fit.rigid == best.rigid):
        further = len(more.numbers) > len(best.numbers) > 0
        if further and is_worth(more, best, SIMULATORS, bare[best.rigid]):
            best = more
    alike = tuple(fit for fit in explaining if fit.numbers == best.numbers)
    return Shape(nominal=bare[best.rigid], chosen=best, alike=alike)


def fits(nominal: Spec, parts: Sequence[Held], simulate: Simulate) -> list[Fit]:
    """All subsets with both kinds of contacts, and a mass beside the nominal engine's."""
    found = [
        Fit(numbers=some, rigid=rigid, sizes=GIVEN * (SOFTNESS in some))
        for some, rigid in (*product(SUBSETS, (False, True)), ((MASS,), False))
    ]
    for _ in range(ROUNDS):
        steps = ((0.0, 0.0, PROBE * (MASS in fit.numbers)) for fit in found)
        heavy = [replace(f, sizes=f.sizes + step) for f, step in zip(found, steps, strict=True)]
        shown = simulate_grasps(simulate, [fit.on(nominal) for fit in (*found, *heavy)], parts)
        pairs = zip(found, shown, shown[len(found) :], strict=False)
        found = [fit.closer(nominal, parts, *pair) for fit, *pair in pairs]
    return found


def _explains(fit: Fit, nominal: Fit) -> bool:
    """Whether a fit takes its share of the gaps and leaves what is ordinary."""
    if not fit.numbers:
        return fit.worst <= SIMULATORS.floors
    enough = not fit.is_soft or fit.sizes[1] >= LEAST_M_N
    return enough and is_named(fit, nominal, SIMULATORS)
