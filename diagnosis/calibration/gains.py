"""PD gains per joint by CMA-ES, as in the paper: replay the commands, minimise the error.

    min over kp, kd > 0 of the sum over t of |q_sim(t; kp, kd) - q_real(t)|

Pushes with a known torque are part of the commands. They fix the scale that gains, inertia and
friction otherwise share.

Every joint has its own search, and all searches share the simulations: candidate k of every joint
is world k. Fingers hardly move each other, and this coupling vanishes as the searches converge.

q is the motor's angle where it was logged, because the PD law sees that; else the joint's. A joint
with play floats between its teeth, and a thousandth of a degree decides where. Such samples say
nothing about gains. So samples at which slightly different worlds disagree are left out.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import cma
import numpy as np

from backends.effects import kd_scale, kp_scale
from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.worlds import READINGS, Motion, replay
from diagnosis.motion.batch import Simulate

CANDIDATES, GENERATIONS = 12, 25
FIRST_STD, CONVERGED_STD = 0.1, 1e-3
"""Step sizes at the start and at the end."""
SCALES = 1 + np.array([kp_scale.Effect.bounds, kd_scale.Effect.bounds])
"""Smallest and largest kp and kd over nominal that are tried: the bounds of the effects."""
TO_LOG_GAINS = np.array([[2.0, 0.0], [2.0, 1.0]])
"""Coordinates of the search, as logarithms: kp and kd together, which few motions show and which
gets double steps, and kd over kp, which decides how fast a joint follows."""
LEAST_MOTION_RAD = np.radians(0.5)
LEAST_SAMPLES = 200
JITTERED, JITTER_PLAY, JITTER_START = 16, 0.03, 0.3
"""Slightly different worlds: they differ by shares of the play, in its size and in the start."""
PREDICTABLE_RAD = 1e-3
"""Samples are left out where the standard deviation over these worlds is larger [rad]."""
_DIVERGED_RAD = 1e3
"""Error of a candidate whose simulation diverges [rad]."""

Progress = Callable[[int], None]
"""Called with the number of finished generations or rounds."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """The data on which the gains of one joint are judged."""

    channel: int
    """Row of `READINGS`."""
    used: tuple[Array, ...]
    """Per motion, the samples that are used, shape (T,), bool."""

    @property
    def samples(self) -> int:
        """Number of samples that are used."""
        return int(sum(used.sum() for used in self.used))


@dataclass(frozen=True, kw_only=True)
class GainFit:
    """The final distribution of a search: kp and kd of one joint."""

    scale: Array
    """Its mean, over nominal, shape (2,)."""
    std: Array
    """Its relative standard deviations, shape (2,)."""


def with_gains(spec: Spec, scale: Array) -> Spec:
    """The world with kp and kd of each joint multiplied by `scale`, shape (J, 2)."""
    return spec.with_drives(
        dataclasses.replace(
            drive,
            kp_nm_rad=drive.kp_nm_rad * float(kp),
            kd_nms_rad=drive.kd_nms_rad * float(kd),
        )
        for drive, (kp, kd) in zip(spec.drives, scale, strict=True)
    )


def reason_against(motions: Sequence[Motion], j: int) -> str | None:
    """The reason why these motions cannot identify the gains of joint `j`, if there is one."""
    if not motions:
        return "not identifiable from this log: it has no steps, multisine, triangle or known push"
    ends = [np.quantile(m.read_rad[0, :, j], (0.01, 0.99)) for m in motions]
    moved = max(float(high - low) for low, high in ends)
    if moved < LEAST_MOTION_RAD:
        return (
            f"not identifiable from this log: it moves by {np.degrees(moved):.2g} deg in free air; "
            f"needed: {np.degrees(LEAST_MOTION_RAD):g} deg"
        )
    samples = sum(len(m.tick) for m in motions)
    if samples < LEAST_SAMPLES:
        return f"not identifiable from this log: {samples} samples; needed: {LEAST_SAMPLES}"
    return None


def _jittered(world: Spec, rng: np.random.Generator) -> tuple[list[Spec], Array]:
    """W slightly different worlds, and the offsets of their start [rad], shape (W, J)."""
    play = np.array([d.play_rad for d in world.drives])
    specs = []
    for share in rng.uniform(1 - JITTER_PLAY, 1 + JITTER_PLAY, (JITTERED, len(play))):
        pairs = zip(world.drives, play * share, strict=True)
        specs.append(world.with_drives(dataclasses.replace(d, play_rad=float(p)) for d, p in pairs))
    return specs, play * rng.uniform(-JITTER_START, JITTER_START, (JITTERED, len(play)))


def judge(
    simulate: Simulate, world: Spec, motions: Sequence[Motion], rng: np.random.Generator
) -> tuple[list[Trace], list[Array]]:
    """The data of each joint, and the replay of worlds that differ slightly from `world`.

    All worlds of that replay explain the log equally well.
    """
    specs, offset_rad = _jittered(world, rng)
    alike = replay(simulate, specs, motions, offset_rad)
    apart = [shown.std(axis=0) for shown in alike]
    found = []
    for j in range(len(world.drives)):
        motor = all(np.isfinite(m.read_rad[1, :, j]).all() for m in motions)
        used = tuple(a[int(motor), :, j] < PREDICTABLE_RAD for a in apart)
        found.append(Trace(channel=READINGS.index("motor" if motor else "position"), used=used))
    return found, alike


def errors(shown: Sequence[Array], motions: Sequence[Motion], trace: Trace, j: int) -> Array:
    """Mean absolute error of joint `j` [rad] in each world of a replay, shape (W,)."""
    total = np.zeros(len(shown[0]))
    for path, motion, used in zip(shown, motions, trace.used, strict=True):
        miss = path[:, trace.channel, :, j] - motion.read_rad[trace.channel, :, j]
        total += np.abs(miss[:, used]).sum(axis=1)
    return np.nan_to_num(total / max(trace.samples, 1), nan=_DIVERGED_RAD)


def search(
    simulate: Simulate,
    world: Spec,
    motions: Sequence[Motion],
    joints: Sequence[int],
    rng: np.random.Generator,
    progress: Progress = lambda generations: None,
) -> dict[int, GainFit]:
    """The gains of `joints` by CMA-ES; other joints keep those of `world`."""
    judged, _ = judge(simulate, world, motions, rng)
    searches = {j: _cma(rng) for j in joints}
    for generation in range(GENERATIONS):
        asked = {j: es.ask() for j, es in searches.items()}
        candidates = [
            with_gains(world, _scales(world, {j: asked[j][k] for j in joints}))
            for k in range(CANDIDATES)
        ]
        shown = replay(simulate, candidates, motions)
        for j, es in searches.items():
            es.tell(asked[j], list(errors(shown, motions, judged[j], j)))
        progress(generation + 1)
        if all(es.result.stds.max() < CONVERGED_STD for es in searches.values()):
            break
    return {j: _found(es) for j, es in searches.items()}


def _cma(rng: np.random.Generator) -> cma.CMAEvolutionStrategy:
    options = {
        "popsize": CANDIDATES,
        "verbose": -9,
        "seed": np.nan,
        "randn": lambda *shape: rng.standard_normal(shape),
    }
    return cma.CMAEvolutionStrategy(np.zeros(2), FIRST_STD, options)


def _scales(world: Spec, points: Mapping[int, Array]) -> Array:
    """Gains over nominal, shape (J, 2), from points in the coordinates of the search."""
    scale = np.ones((len(world.drives), 2))
    for j, point in points.items():
        scale[j] = np.clip(np.exp(TO_LOG_GAINS @ point), *SCALES.T)
    return scale


def _found(search: cma.CMAEvolutionStrategy) -> GainFit:
    covariance = TO_LOG_GAINS @ (search.sigma**2 * search.sm.C) @ TO_LOG_GAINS.T
    mean = np.exp(TO_LOG_GAINS @ search.result.xfavorite)
    return GainFit(scale=np.clip(mean, *SCALES.T), std=np.sqrt(np.diag(covariance)))
