"""Uncertainty of the gains, and effects that look like other gains.

Standard deviations come from a block bootstrap (Kuensch, Annals of Statistics 17, 1989). Half
seconds of the log are drawn with replacement, and the sum of absolute errors is minimised again on
the linearised replay, each time in another of the slightly different worlds. So the standard
deviations contain measurement noise, model errors that vary between half seconds, and the unknown
position of a joint within its play. The standard deviations of CMA-ES only say how far it
converged.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.effect import Effect
from backends.effects import (
    command_delay,
    coulomb_friction,
    link_mass,
    rotor_inertia,
    series_elasticity,
    torque_limit,
    viscous_friction,
)
from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.refine import Linear, Refined, used
from diagnosis.calibration.robust import least_absolute
from diagnosis.calibration.worlds import Motion, replay
from diagnosis.motion.batch import Simulate

BLOCK_S = 0.5
DRAWS = 100
CONFOUNDED_SHARE = 0.9
"""An effect is confounded with gains if they explain more than this share of its trace."""


@dataclass(frozen=True, kw_only=True)
class Confusion:
    """An effect whose trace looks like other gains."""

    effect: Effect
    share: float
    """Share of its trace (sum of squares) that gains explain."""
    reads_as: Array
    """Relative change of kp and kd that it looks like, shape (2,)."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """Uncertainty of the gains of one joint."""

    std: Array
    """Relative standard deviations of kp and kd, shape (2,)."""
    correlation: float
    """Correlation of kp with kd."""
    confused: tuple[Confusion, ...]


def spreads(
    simulate: Simulate,
    world: Spec,
    motions: Sequence[Motion],
    refined: Refined,
    rng: np.random.Generator,
) -> dict[int, Spread]:
    """The uncertainty of the joints in `refined`, whose replays are about the gains of `world`."""
    probes = {j: _probes(world, j) for j in refined.linear}
    worlds = [probe.on_spec(world) for of_joint in probes.values() for probe in of_joint]
    shown = replay(simulate, worlds, motions) if worlds else []
    found, done = {}, 0
    for j, about in refined.linear.items():
        drawn = bootstrap(about.miss_rad, about.columns, _blocks(world, motions, about), rng)
        moved = used(shown, about.trace, j)[:, about.straight] - about.path_rad
        mine = slice(done, done + len(probes[j]))
        found[j] = Spread(
            std=np.hypot(drawn.std(axis=0, ddof=1), refined.scatter[j]),
            correlation=float(np.corrcoef(drawn.T)[0, 1]),
            confused=tuple(_confusions(about.columns, moved[mine], probes[j])),
        )
        done = mine.stop
    return found


def bootstrap(miss: Array, columns: Array, block: Array, rng: np.random.Generator) -> Array:
    """Refitted changes of the gains' logarithms, shape (DRAWS, 2).

    `miss` is (W, T), `columns` (T, 2); `block` (T,) numbers the blocks from 0 without gaps.
    """
    count = int(block.max()) + 1
    draws = rng.multinomial(count, np.full(count, 1 / count), size=DRAWS)
    pairs = zip(rng.integers(len(miss), size=DRAWS), draws, strict=True)
    return np.stack([least_absolute(miss[w], columns, times[block]) for w, times in pairs])


def _probes(world: Spec, j: int) -> list[Effect]:
    """Effects on joint `j`, of sizes that are usual for a real drive."""
    drive, joint = world.drives[j], world.hand.joint_names[j]
    sizes: list[tuple[type[Effect], float]] = [
        (viscous_friction.Effect, 0.1 * drive.kd_nms_rad),
        (coulomb_friction.Effect, 0.01 * drive.torque_limit_nm),
        (rotor_inertia.Effect, 0.2 * drive.rotor_inertia_kgm2),
        (link_mass.Effect, 0.2),
        (command_delay.Effect, 2e-3),
        (series_elasticity.Effect, 0.2),
        (torque_limit.Effect, -0.2),
    ]
    return [kind(magnitude=size, joint=joint) for kind, size in sizes]


def _blocks(world: Spec, motions: Sequence[Motion], about: Linear) -> Array:
    """Number of the half second that each sample belongs to."""
    ticks = round(BLOCK_S / world.timing.drive_s)
    last, numbers = 0, []
    for motion, rows in zip(motions, about.trace.used, strict=True):
        numbers.append(last + motion.tick[rows] // ticks)
        last += motion.tick[-1] // ticks + 1
    return np.unique(np.concatenate(numbers)[about.straight], return_inverse=True)[1]


def _confusions(columns: Array, moved: Array, effects: Sequence[Effect]) -> list[Confusion]:
    found = []
    for effect, path in zip(effects, moved, strict=True):
        x = np.linalg.lstsq(columns, path, rcond=None)[0]
        total = float(path @ path)
        share = 1 - float(np.sum((path - columns @ x) ** 2)) / total if total > 0 else 0.0
        if share > CONFOUNDED_SHARE:
            found.append(Confusion(effect=effect, share=share, reads_as=x))
    return found
