"""Friction and mass of the stick, from episodes in which it is pulled out of the grip.

The stick slips where pull and weight exceed friction, and falls by Newton's law from there,

    m x'' = F(t) + m g - mu sum(N),   x: how far it has slipped towards its lower end

where contacts are rigid. So the pull at which it slips tells mu, given the forces of a replay, and
how fast it goes then tells m. Contacts that creep, as the nominal engine's, slip otherwise: there
replays of other masses are fitted. Which kind contacts are, gaps tell (`shape`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.catalogue import Catalogue, of_part
from backends.spec import Spec
from backends.state import Array
from diagnosis.grasp.forward_model import FRICTION, MASS, simulate_grasps
from diagnosis.grasp.slip_model import GONE_M, Slip, newton, slip, valley
from diagnosis.motion.batch import Simulate
from diagnosis.motion.held import Held
from diagnosis.verdict.result import UNKNOWN, Z90, Report, cause, missing

FINE_S = 1e-3
"""Replays are read this often."""
REPLAYED = (0.25, 0.4, 0.6, 0.8, 1.0, 1.3, 1.8, 2.6, 4.0)
"""Masses that are replayed first, over the nominal one."""
SHIFTS_S = np.arange(-0.08, 0.0801, 2.5e-4)
"""How much later or earlier a stick slips than in a replay."""
BEFORE_S = np.array([0.03, 0.005])
"""Forces just before a stick slips are taken between these times before."""
STRONGER, MORE_S = 3.0, 1.0
"""A replay is pulled so much harder than the stick was, and for so much longer, at most [1, s]."""
FRICTION_FLOOR, SOFT_FLOOR = 0.03, 0.02
"""Engines agree on the pull at which a stick slips to 0.02, relative; soft contacts add as much."""
WANDERS = 0.011
"""Friction changes by this while the stick slips, relative: the pull must outgrow that."""
MASS_FLOOR = 0.04
"""Least standard deviation of a mass by Newton's law, as a logarithm."""
MASS_FLOOR_REPLAYED = 0.13
"""The same of replays, which are as good as the pose that they start from."""
LAWFUL, ODD = 1.25, 1.8
"""Newton's law that leaves less than the one holds, however soft contacts are. A slip of which a
model leaves more than the other is of another kind."""
SURE_Z = 3.0
HEAVY_Z = 2.2
"""A heavy stick is asked for less: no contact makes one look so."""
GIVES_WAY = 0.25
"""Hard contacts may hold until they give way at once, which looks light where sticks slip by
Newton's law: what that adds to the standard deviation of a mass, as a logarithm."""
VAGUE = (
    "within {:.0f} % of the nominal one as far as these pulls tell; pull more often (--variants), "
    "by about 100 N/s, or weigh the stick"
)
OTHERWISE = (
    "not identifiable from this log: the stick slips neither by Newton's law nor as in the nominal "
    "engine, or its contacts are soft; weigh it"
)


@dataclass(frozen=True, kw_only=True)
class PullFit:
    """What pulls tell of friction and mass."""

    logs: Array
    """Logarithms of both over what is nominal, shape (2,)."""
    std: Array
    """Their standard deviations, shape (2,)."""
    left: float
    """Root mean square of what the model leaves, over its standard deviation."""
    episodes: int
    """That slipped."""
    gives_way: bool = False
    """Whether contacts may hold until they give way at once, which looks light."""

    def report(self, catalogue: Catalogue) -> Report:
        """What is sure, `unknown` without a name by its number; and what is missing of the rest."""
        names = of_part(catalogue, "stick")
        odds = (self.logs / self.spread) ** 2
        share = float(np.sum(odds[self.sure]) / max(np.sum(odds), 1e-9))
        text = f"{self.episodes} sticks that were pulled out slipped otherwise"
        sizes = np.expm1(self.logs[:, None] + np.outer(self.spread, (0.0, -Z90, Z90))).tolist()
        found = zip((FRICTION, MASS), sizes, self.sure, strict=True)
        effects = [(names.get(number, UNKNOWN), ends) for number, ends, is_sure in found if is_sure]
        causes = (cause(*one, catalogue, share=share, evidence=text) for one in effects)
        doubt = OTHERWISE
        if self.left < ODD:
            doubt = VAGUE.format(100 * np.expm1(SURE_Z * self.spread[1]))
        vague = [names[MASS]] if MASS in names and not self.sure[1] else []
        return Report(causes=tuple(causes)) + missing(vague, doubt)

    @property
    def sure(self) -> Array:
        """Whether friction and mass are other than nominal, shape (2,)."""
        asked = np.array([SURE_Z, HEAVY_Z if self.logs[1] > 0 else SURE_Z])
        lawful = np.array([True, self.left < ODD])
        return np.asarray(lawful & (np.abs(self.logs) > asked * self.spread))

    @property
    def surely(self) -> Array:
        """Friction and mass as far as they are sure, as logarithms, shape (2,)."""
        return np.where(self.sure, self.logs, 0.0)

    @property
    def spread(self) -> Array:
        """The standard deviations, of a mass more where a grip gives way at once, shape (2,)."""
        return np.hypot(self.std, [0.0, GIVES_WAY * (self.gives_way and self.logs[1] < 0)])


def pull_fit(
    world: Spec, parts: Sequence[Held], simulate: Simulate, rigid: bool, soft: bool
) -> PullFit | None:
    """What some episodes tell of friction and mass; None where no stick slips.

    Sticks slip by Newton's law between `rigid` contacts, else as in the nominal engine. Soft ones
    yield along the stick as well: they tell a mass where Newton's law holds, and friction less.
    """
    slips = [slip(part, world.gravity_m_s2) for part in parts]
    pairs = [(p, s) for p, s in zip(parts, slips, strict=True) if s and s.slips]
    if not pairs:
        return None
    kept, seen = [p for p, _ in pairs], [s for _, s in pairs]
    (shown,) = _replays(world, kept, simulate, (1.0,))
    if rigid and all(one.slips for one in shown):
        fit = replace(_by_newton(seen, shown, world), gives_way=not soft)
    else:
        fit = _by_replays(world, kept, seen, simulate)
    if soft and not (rigid and fit.left < LAWFUL):
        fit = replace(fit, std=np.hypot(fit.std, [SOFT_FLOOR, 0.0]), left=np.inf)
    return fit


def _by_newton(seen: Sequence[Slip], shown: Sequence[Slip], world: Spec) -> PullFit:
    """The mass that Newton's law tells, and friction over what the forces of replays can hold."""
    mass, mass_std, friction_n, left = newton(seen, world.stick.mass_kg)
    pressed_n = []
    for one in shown:
        first, last = np.searchsorted(one.time_s, one.slips_s - BEFORE_S)
        pressed_n.append(float(one.pressed_n[first : max(last, first + 1)].mean()))
    ratios = np.log(friction_n / (world.stick.friction * np.array(pressed_n)))
    gained_n = [s.pull_n[: s.end + 1][-1] - s.slipped_n for s in seen]
    wanders = [WANDERS * s.slipped_n / max(n, 1e-3) for s, n in zip(seen, gained_n, strict=True)]
    return PullFit(
        logs=np.array([ratios.mean(), mass]),
        std=np.array([_spread(ratios), np.linalg.norm([mass_std, np.mean(wanders), MASS_FLOOR])]),
        left=left,
        episodes=len(seen),
    )


def _spread(ratios: Array) -> float:
    """Standard deviation of the mean friction of some episodes, which share an error."""
    few, floor = len(ratios) < 2, FRICTION_FLOOR
    return float(np.hypot(floor, floor if few else ratios.std(ddof=1) / np.sqrt(len(ratios))))


def _replays(
    world: Spec, parts: Sequence[Held], simulate: Simulate, masses: Sequence[float]
) -> list[list[Slip]]:
    """Slips on the nominal engine by mass over the nominal one, read every `FINE_S`."""
    fine = [_finely(part) for part in parts]
    worlds = [changed(world, mass=float(np.log(m))) for m in masses]
    every = simulate_grasps(simulate, worlds, fine)
    rows = [[slip(part, world.gravity_m_s2) for part in shown] for shown in every]
    return [[one for one in slips if one is not None] for slips in rows]


def _finely(part: Held) -> Held:
    """An episode whose commands stand in rows every `FINE_S`, each of them until the next.

    Its pull goes on growing to `STRONGER` times the largest, for a replay may slip later.
    """
    rises = np.diff(part.pull_n[-2:])[0] / np.diff(part.time_s[-2:])[0]
    more_s = (STRONGER - 1) * part.pull_n[-1] / max(rises, 1e-3)
    end_s = part.time_s[-1] + min(more_s, MORE_S)
    times = np.arange(0.0, end_s + FINE_S / 2, FINE_S)
    rows = np.searchsorted(part.time_s, times + FINE_S / 2, side="right") - 1
    fine = replace(part.every(rows), time_s=times)
    return replace(fine, pull_n=fine.pull_n + rises * np.maximum(times - part.time_s[-1], 0.0))


def _by_replays(
    world: Spec, parts: Sequence[Held], seen: Sequence[Slip], simulate: Simulate
) -> PullFit:
    """The mass whose replays fit, once more where friction is what the first ones make of it."""
    played = _replays(world, parts, simulate, REPLAYED)
    first = _shifted(seen, played, REPLAYED, world.stick.mass_kg)
    friction, mass = first.logs
    near = np.exp(mass) * np.array([0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4])
    other = changed(world, friction=friction)
    again = _shifted(seen, _replays(other, parts, simulate, near), near, world.stick.mass_kg)
    return replace(again, logs=again.logs + [friction, 0.0])


def _shifted(
    seen: Sequence[Slip], played: Sequence[Sequence[Slip]], masses: Sequence[float], mass_kg: float
) -> PullFit:
    """The mass whose replays fit where each may slip later, which tells friction."""
    costs, ratios = np.zeros(len(masses)), np.zeros((len(masses), len(seen)))
    rises_n_s = [(np.diff(s.pull_n) / np.diff(s.time_s))[s.slipping - 1] for s in seen]
    for m, slips in enumerate(played):
        for e, (real, model) in enumerate(zip(seen, slips, strict=True)):
            cost, later_s = _best_shift(real, model)
            costs[m] += cost
            pull_n = model.slipped_n if model.slips else model.pull_n[-1]
            friction_n = pull_n + masses[m] * mass_kg * model.weight
            ratios[m, e] = np.log(max(1 + rises_n_s[e] * later_s / friction_n, 1e-3))
    mass, half = valley(np.log(masses), costs)
    k = int(np.argmin(costs))
    left = float(np.sqrt(costs[k] / sum(s.end for s in seen)))
    return PullFit(
        logs=np.array([ratios[k].mean(), mass]),
        std=np.array([_spread(ratios[k]), np.hypot(half, MASS_FLOOR_REPLAYED) * max(left, 1.0)]),
        left=left,
        episodes=len(seen),
    )


def _best_shift(real: Slip, model: Slip) -> tuple[float, float]:
    """Least cost of a replay that slips later than it does, and by how much [s]."""
    later_s = real.slips_s - model.slips_s + SHIFTS_S
    known = slice(0, real.end)
    at = real.time_s[known, None] - later_s
    moved = np.interp(at, model.time_s, np.minimum(model.travel_m, 2 * GONE_M))
    costs = (((moved - real.travel_m[known, None]) / real.spread_m[:, None]) ** 2).sum(axis=0)
    best = int(np.argmin(costs))
    return float(costs[best]), float(later_s[best])


def changed(world: Spec, friction: float = 0.0, mass: float = 0.0) -> Spec:
    """A world with other friction and mass, given as logarithms of ratios."""
    ratios = {"friction": np.exp(friction), "mass_kg": np.exp(mass)}
    stick = {name: getattr(world.stick, name) * ratio for name, ratio in ratios.items()}
    return replace(world, stick=replace(world.stick, **stick))
