"""One stick that is pulled out of the grip: how far it slips, and what Newton's law makes of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.state import Array, quat_z_axis
from diagnosis.motion.held import Held
from diagnosis.motion.recordings import white_noise

LEAST_S = 0.2
"""A stick is held so long, at least, before it is pulled."""
SLIPPED_M, GONE_M = 1e-3, 15e-3
"""It slips from the one on, and what it does beyond the other tells nothing of the grip."""
MASSES = np.geomspace(0.15, 8.0, 81)
"""Masses that are tried, over the nominal one."""
FORCES = 241
"""Friction forces that are tried, around the pull at which it slips."""
NEAR = 0.25
"""They end at this from it, relative."""
CREEP_M = 1e-4
"""Contacts creep by this before they slip."""
MODEL = 0.03
"""Share of a slip by which any model of it may be off."""
MOST_ALIKE = 4.0
"""Deviations that tell as much as one, at most."""


@dataclass(frozen=True, kw_only=True)
class Slip:
    """How one stick was pulled out."""

    time_s: Array
    """Since it was pulled first, shape (T,), 0 first."""
    pull_n: Array
    """From each sample on, shape (T,)."""
    travel_m: Array
    """Towards its lower end, shape (T,)."""
    weight: float
    """Gravity along its way [m/s^2]."""
    noise_m: float
    """Standard deviation of its travel as it is tracked."""
    pressed_n: Array
    """Sum of the normal forces on it, shape (T,), of a replay; NaN of a log."""

    @property
    def slipping(self) -> int:
        """Number of the first sample by which it has slipped; T if it never has."""
        return int(np.argmax(np.append(self.travel_m, np.inf) > SLIPPED_M))

    @property
    def slips(self) -> bool:
        """Whether it has slipped at all."""
        return self.slipping < len(self.time_s)

    @property
    def slips_s(self) -> float:
        """When it has slipped; the end if it never has [s]."""
        return float(self.time_s[min(self.slipping, len(self.time_s) - 1)])

    @property
    def end(self) -> int:
        """Number of the first sample at which it is gone."""
        return int(np.argmax(np.append(self.travel_m, np.inf) > GONE_M))

    @property
    def slipped_n(self) -> float:
        """The pull at which it has slipped by `SLIPPED_M`, between samples."""
        k = self.slipping
        past = (SLIPPED_M - self.travel_m[k - 1]) / (self.travel_m[k] - self.travel_m[k - 1])
        return float(self.pull_n[k - 1] + past * (self.pull_n[k] - self.pull_n[k - 1]))

    @property
    def spread_m(self) -> Array:
        """Standard deviation of a model of it, shape (T,) up to its end."""
        known = self.travel_m[: self.end]
        return np.hypot(self.noise_m, MODEL * np.maximum(known, 0.0))


def slip(part: Held, gravity_m_s2: Sequence[float]) -> Slip | None:
    """An episode as one slip; None where the stick was not held still before it was pulled."""
    pulled = part.pull_n > 0
    first = int(np.argmax(pulled))
    before = (np.arange(len(pulled)) < first) & (part.time_s > part.time_s[first] - LEAST_S)
    if not pulled.any() or part.time_s[first] < LEAST_S:
        return None
    axis = quat_z_axis(part.stick[before, 3:]).mean(axis=0)
    axis /= np.linalg.norm(axis)
    travel = -(part.stick[:, :3] - part.stick[before, :3].mean(axis=0)) @ axis
    travel = np.nan_to_num(travel, nan=np.inf)  # a replay that burst after it was gone
    return Slip(
        time_s=part.time_s[first:] - part.time_s[first],
        pull_n=part.pull_n[first:],
        travel_m=travel[first:],
        weight=float(-np.dot(gravity_m_s2, axis)),
        noise_m=max(float(white_noise(part.stick[:first, :3]).mean()), CREEP_M),
        pressed_n=part.force_n[first:].sum(axis=1),
    )


def newton(slips: Sequence[Slip], mass_kg: float) -> tuple[float, float, Array, float]:
    """What makes Newton's law fit: the mass, as a logarithm over `mass_kg`, and frictions [N].

    That is the mass and its standard deviation, the friction by episode, and what is left, root
    mean square.
    """
    near, masses = np.linspace(1 - NEAR, 1 + NEAR, FORCES), mass_kg * MASSES
    forces = [one.slipped_n * near for one in slips]
    costs = [_falls(one, masses, force) for one, force in zip(slips, forces, strict=True)]
    total = np.sum([cost.min(axis=1) for cost in costs], axis=0)
    best, half = valley(np.log(MASSES), total)
    k = int(np.argmin(total))
    left = float(np.sqrt(total[k] / sum(s.end for s in slips)))
    pairs = zip(forces, costs, strict=True)
    return best, half, np.array([force[np.argmin(cost[k])] for force, cost in pairs]), left


def valley(places: Array, costs: Array) -> tuple[float, float]:
    """Where squared deviations are least, by a parabola, and the standard deviation of that."""
    k = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
    a, b, _ = np.polyfit(places[k - 1 : k + 2] - places[k], costs[k - 1 : k + 2], 2)
    if a <= 0:
        return float(places[np.argmin(costs)]), float(places[1] - places[0])
    scale = float(np.clip(costs.min(), 1.0, MOST_ALIKE))
    moved = np.clip(-b / (2 * a), places[k - 1] - places[k], places[k + 1] - places[k])
    return float(places[k] + moved), float(np.sqrt(scale / a))


def _falls(one: Slip, masses: Array, frictions_n: Array) -> Array:
    """Squared deviations of falls by Newton's law, by mass and friction (M, F)."""
    x, v, costs = np.zeros((3, len(masses), len(frictions_n)))
    steps_s = np.diff(one.time_s, append=one.time_s[-1])
    rows = zip(one.pull_n, one.travel_m, one.spread_m, steps_s, strict=False)
    for pull_n, travel_m, spread_m, dt in rows:
        costs += ((x - travel_m) / spread_m) ** 2
        a = (pull_n - frictions_n) / masses[:, None] + one.weight
        slips = (v > 0.0) | (a >= 0.0)
        x += slips * (v * dt + a * dt * dt / 2)
        v = slips * np.maximum(v + a * dt, 0.0)
    return costs
