"""PD gains per joint, as in the paper: replay the commands, minimise the error.

    min over kp, kd > 0 of the sum over t of |q_sim(t; kp, kd) - q_real(t)|

Pushes with a known torque are part of the commands. They fix the scale that gains, inertia and
friction otherwise share.

Candidates around the gains so far are replayed, each in a slightly different world, and lines are
fitted to the angles that they show: the least error follows, without samples that are not linear,
and the next candidates are around that. All joints share the simulations: candidate k of every
joint is world k. Fingers hardly move each other, and this coupling vanishes as the steps do.

q is the motor's angle where it was logged, because the PD law sees that; else the joint's. A joint
with play floats between its teeth, and a thousandth of a degree decides where. Such samples say
nothing about gains.

A block bootstrap (Kuensch, Annals of Statistics 17, 1989) draws half seconds of the log and
candidates with replacement and asks for the least error each time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.effects import kd_scale, kp_scale
from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.backlash import least_absolute
from diagnosis.motion.batch import Simulate, replay
from diagnosis.motion.recordings import Recording

SCALES = 1 + np.array([kp_scale.Effect.bounds, kd_scale.Effect.bounds])
"""Smallest and largest kp and kd over nominal that are tried: the bounds of the effects."""
TO_LOG_GAINS = np.array([[2.0, 0.0], [2.0, 1.0]])
"""From the coordinates of candidates to logarithms of gains: kp and kd together, which few motions
show and which gets double steps, and kd over kp, which decides how fast a joint follows."""
AROUND, NEAR_STD = 48, 0.02
"""How many candidates are replayed, and their standard deviation in their coordinates."""
LARGEST_STEP, LAST_STEP = 0.2, 0.01
"""The largest step of a gain's logarithm in a round; after smaller ones no round follows."""
BLOCK_S, DRAWS = 0.5, 100
LEAST_MOTION_RAD = np.radians(0.5)
LEAST_SAMPLES = 200
JITTER_PLAY, JITTER_START = 0.03, 0.3
"""Slightly different worlds: they differ by shares of the play, in its size and in the start."""
PREDICTABLE_RAD = 1e-3
"""Samples are left out where the standard deviation of worlds about lines is larger [rad]."""
_DIVERGED_RAD = 1e3
"""Error of a candidate whose simulation diverges [rad]."""

Progress = Callable[[int], None]
"""Called with the number of finished rounds."""
Terms = tuple[Array, Array, Array, Array]
"""What `least_error` takes of a joint."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """The readings by which gains are judged, those of all motions end to end."""

    is_motor: Array
    """Whether a joint's motor is compared, else its position, shape (J,), bool."""
    used: Array
    """Which samples count, shape (T, J), bool."""

    @classmethod
    def of(cls, motions: Sequence[Recording]) -> "Compared":
        """All readings, the motor's where it was logged all the time."""
        is_motor = np.all([np.isfinite(m.measured[:, 1]).all(axis=0) for m in motions], axis=0)
        shape = sum(len(m.time_s) for m in motions), len(is_motor)
        return cls(is_motor=is_motor, used=np.ones(shape, dtype=bool))

    def angles(self, readings: Sequence[Array]) -> Array:
        """What is compared, (..., T, J), of readings (..., T, 2 or more, J) by motion."""
        whole = np.concatenate(list(readings), axis=-3)
        return np.where(self.is_motor, whole[..., 1, :], whole[..., 0, :])

    def errors(self, shown: Sequence[Array], motions: Sequence[Recording]) -> Array:
        """Absolute errors of a replay [rad], 0 of what does not count, shape (W, T, J)."""
        miss = self.angles(shown) - self.angles([m.measured for m in motions])
        return np.nan_to_num(np.abs(miss) * self.used, nan=_DIVERGED_RAD, posinf=_DIVERGED_RAD)


@dataclass(frozen=True, kw_only=True)
class GainFit:
    """kp and kd of one joint: the mean over nominal and the relative standard deviations, (2,)."""

    scale: Array
    std: Array
    correlation: float


def with_gains(spec: Spec, scale: Array, play_rad: Array | None = None) -> Spec:
    """The world with kp and kd of each joint multiplied by `scale`, shape (J, 2); its play (J,)."""
    drives = []
    for j, (drive, (kp, kd)) in enumerate(zip(spec.drives, scale, strict=True)):
        play = drive.play_rad if play_rad is None else float(play_rad[j])
        both = drive.kp_nm_rad * float(kp), drive.kd_nms_rad * float(kd)
        drives.append(replace(drive, kp_nm_rad=both[0], kd_nms_rad=both[1], play_rad=play))
    return spec.with_drives(drives)


def reason_against(motions: Sequence[Recording], j: int) -> str | None:
    """The reason why these motions cannot identify the gains of joint `j`, if there is one."""
    if not motions:
        return "not identifiable from this log: it has no steps, multisine, triangle or known push"
    ends = [np.quantile(m.measured[:, 0, j], (0.01, 0.99)) for m in motions]
    moved = max(float(high - low) for low, high in ends)
    if moved < LEAST_MOTION_RAD:
        return (
            f"not identifiable from this log: it moves by {np.degrees(moved):.2g} deg in free air; "
            f"needed: {np.degrees(LEAST_MOTION_RAD):g} deg"
        )
    samples = sum(len(m.time_s) for m in motions)
    if samples < LEAST_SAMPLES:
        return f"not identifiable from this log: {samples} samples; needed: {LEAST_SAMPLES}"
    return None


def fit(
    simulate: Simulate,
    nominal: Spec,
    scale: Array,
    motions: Sequence[Recording],
    joints: Sequence[int],
    rng: np.random.Generator,
    rounds: int,
    progress: Progress = lambda rounds: None,
) -> tuple[dict[int, GainFit], Compared]:
    """The gains of `joints` with the least error, from `scale` over `nominal` (J, 2) on.

    `rounds`: how often candidates are replayed, at most.
    """
    for done in range(rounds):
        given, compared = _around(simulate, with_gains(nominal, scale), motions, joints, rng)
        steps = np.zeros_like(scale)
        for j, of_joint in given.items():
            steps[j] = np.clip(least_error(*of_joint), -LARGEST_STEP, LARGEST_STEP)
        scale = np.clip(scale * np.exp(steps), *SCALES.T)
        progress(done + 1)
        if np.abs(steps).max() < LAST_STEP:
            break
    fits = {}
    for j, of_joint in given.items():
        draws = np.array([least_error(*of_joint, rng) for _ in range(DRAWS)])
        both = float(np.corrcoef(draws.T)[0, 1])
        fits[j] = GainFit(scale=scale[j], std=draws.std(axis=0, ddof=1), correlation=both)
    return fits, compared


def _around(
    simulate: Simulate,
    world: Spec,
    motions: Sequence[Recording],
    joints: Sequence[int],
    rng: np.random.Generator,
) -> tuple[dict[int, Terms], Compared]:
    """What worlds around one show of joints, as far as it is linear; and what is compared."""
    play = np.array([drive.play_rad for drive in world.drives])
    shares = rng.uniform(1 - JITTER_PLAY, 1 + JITTER_PLAY, (AROUND, len(play)))
    offset_rad = play * rng.uniform(-JITTER_START, JITTER_START, (AROUND, len(play)))
    points = np.zeros((AROUND, len(play), 2))
    points[:, joints] = rng.standard_normal((AROUND, len(joints), 2))
    points = NEAR_STD * points @ TO_LOG_GAINS.T
    pairs = zip(np.exp(points), play * shares, strict=True)
    candidates = [with_gains(world, gains, plays) for gains, plays in pairs]
    compared = Compared.of(motions)
    shown = compared.angles(replay(simulate, candidates, motions, offset_rad))
    read = compared.angles([motion.measured for motion in motions])
    blocks = [motion.time_s // BLOCK_S for motion in motions]
    block = np.cumsum(np.concatenate([np.diff(one, prepend=-1.0) > 0 for one in blocks])) - 1
    given = {}
    for j in joints:
        terms = np.column_stack([np.ones(AROUND), points[:, j]])
        linear = terms @ np.linalg.lstsq(terms, shown[..., j])[0]
        used = np.std(shown[..., j] - linear, axis=0) < PREDICTABLE_RAD
        compared.used[:, j] = used
        if used.sum() >= LEAST_SAMPLES:
            given[j] = terms, shown[:, used, j], read[used, j], block[used]
    return given, compared


def least_error(
    terms: Array, shown: Array, read: Array, block: Array, rng: np.random.Generator | None = None
) -> Array:
    """Which gains show the angles read (T,), as logarithms (2,).

    `terms` (W, 3): 1 and the logarithms of the gains of worlds that show angles (W, T). With `rng`,
    worlds and blocks (T,) of samples are drawn.
    """
    rows, times = np.arange(len(terms)), np.ones(int(block.max()) + 1)
    if rng is not None:
        rows = rng.integers(len(terms), size=len(terms))
        times = rng.multinomial(len(times), np.full(len(times), 1 / len(times))).astype(float)
    about, *columns = np.linalg.lstsq(terms[rows], shown[rows])[0]
    return least_absolute(read - about, np.transpose(columns), times[block])
