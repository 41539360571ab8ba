"""PD gains per joint, as in the paper: replay the commands, minimise the error.

    min over kp, kd > 0 of the sum over t of |q_sim(t; kp, kd) - q_real(t)|

Pushes with a known torque are part of the commands. They fix the scale that gains, inertia and
friction otherwise share.

Candidates around the gains so far are replayed, each in a slightly different world, and lines are
fitted to the angles that they show: the least error follows, without samples that are not linear,
and the next candidates are around that. The joints of a limb share the replays: candidate k of each
is world k. They hardly move each other, and this coupling vanishes as the steps do.

q is the motor's angle where it was logged, because the PD law sees that; else the joint's. A joint
with play floats between its teeth, and a thousandth of a degree decides where. Such samples say
nothing about gains.

A block bootstrap (Kuensch, Annals of Statistics 17, 1989) draws half seconds of the log and
candidates with replacement and asks for the least error each time.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from backends.catalogue import catalogue
from backends.effect import UNITS, NumberEffect
from backends.effects import kd_scale, kp_scale
from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration.backlash import least_absolute
from diagnosis.calibration.result import Gain, Gains
from diagnosis.logs.log import Log
from diagnosis.motion.columns import COLUMNS, KD, KP, PLAY, table
from diagnosis.motion.excerpt import excerpted
from diagnosis.motion.limb import Limb
from diagnosis.replay.parts import limbs

FITTED_S = 400.0
"""Joint-seconds of a log that gains are fitted to."""
SCALES = 1 + np.array([kp_scale.Effect.bounds, kd_scale.Effect.bounds])
"""Smallest and largest kp and kd over nominal that are tried: the bounds of the effects."""
TO_LOG_GAINS = np.array([[2.0, 0.0], [2.0, 1.0]])
"""From the coordinates of candidates to logarithms of gains: kp and kd together, which few motions
show and which gets double steps, and kd over kp, which decides how fast a joint follows."""
AROUND, NEAR_STD = 48, 0.02
"""How many candidates are replayed, and their standard deviation in their coordinates."""
ROUNDS = 15
"""Rounds at most: twelve steps go from nominal gains to any that is tried."""
LARGEST_STEP, LAST_STEP = 0.2, 0.01
"""The largest step of a gain's logarithm in a round; after smaller ones no round follows."""
BLOCK_S, DRAWS = 0.5, 100
LEAST_MOTION_RAD = np.radians(0.5)
LEAST_BLOCKS = 100
"""Fewer means of readings (`Limb.edges`) tell no gains."""
JITTER_PLAY, JITTER_START = 0.03, 0.3
"""Slightly different worlds: they differ by shares of the play, in its size and in the start."""
PREDICTABLE_RAD = 1e-3
"""Samples are left out where the standard deviation of worlds about lines is larger [rad]."""
DIVERGED_RAD = 1e3
"""What a world shows whose replay diverges [rad]."""
LARGEST_STD = 0.3
"""A gain with a larger relative standard deviation is not identified."""
FLOATS = (
    "not identifiable from this log: it floats between its teeth nearly all the time; log its "
    "motor's angle, or move it faster"
)
STEP, SHARE, LEAST = 0.05, 0.9, 0.01
"""An effect is confounded with gains if changes of these, by slopes over a relative `STEP`, explain
more than this share of what it does, and one of them is at least so large."""


def least_error(
    terms: Array,
    shown: Array,
    read: Array,
    block: Array,
    rng: np.random.Generator | None = None,
) -> Array:
    """Which gains show the angles read (T,), as logarithms (2,): what W worlds show is linear.

    `terms`: 1 and the logarithms of the worlds' gains (W, 3); `shown`: their angles (W, T);
    `block`: the half second of each sample (T,). With `rng`, worlds and half seconds are drawn.
    """
    rows, times = np.arange(len(terms)), np.ones(int(block.max()) + 1)
    if rng is not None:
        rows = rng.integers(len(rows), size=len(rows))
        times = rng.multinomial(len(times), np.full(len(times), 1 / len(times))).astype(float)
    about, *columns = np.linalg.lstsq(terms[rows], shown[rows])[0]
    return least_absolute(read - about, np.transpose(columns), times[block])


class GainFit:
    """A limb's gains over those of its nominal world, and the readings by which they are judged."""

    def __init__(self, limb: Limb, nominal: Spec) -> None:
        self.limb, self.draw = limb, dict[int, Callable[..., Array]]()
        self.nominal = table(nominal, limb.rigid)
        now, plain = limb.nominal[:, [KP, KD]], self.nominal[:, [KP, KD]]
        self.scale = np.divide(now, plain, out=np.ones_like(plain), where=plain > 0.0)
        self.by_motor = np.isfinite(limb.measured[:, 1]).all(axis=0)
        self.read = self._compared(limb.measured)
        self.used = np.zeros(self.read.shape, dtype=bool)
        """Which readings count, shape (N, K)."""

    def run(self, joints: Sequence[int], rng: np.random.Generator) -> None:
        """Find the gains of some joints with the least error."""
        halves = [np.diff(time_s // BLOCK_S, prepend=-1.0) > 0 for time_s in self.limb.time_s]
        block = np.cumsum(np.concatenate(halves)) - 1
        for _ in range(ROUNDS):
            points, shown = self._around(joints, rng)
            steps = np.zeros_like(self.scale)
            for j in joints:
                terms = np.column_stack([np.ones(AROUND), points[:, j]])
                linear = terms @ np.linalg.lstsq(terms, shown[..., j])[0]
                used = np.std(shown[..., j] - linear, axis=0) < PREDICTABLE_RAD
                self.used[:, j] = used & (used.sum() >= LEAST_BLOCKS)
                if self.used[:, j].any():
                    known = terms, shown[:, used, j], self.read[used, j], block[used]
                    self.draw[j] = partial(least_error, *known)
                    steps[j] = np.clip(self.draw[j](), -LARGEST_STEP, LARGEST_STEP)
            self.scale = np.clip(self.scale * np.exp(steps), *SCALES.T)
            if np.abs(steps).max(initial=0.0) < LAST_STEP:
                break

    def numbers(self, scale: Array, play: Array | float = 1.0) -> Array:
        """The joints' numbers with so many times the nominal gains (K, 2) and the play (K,)."""
        found = self.limb.nominal.copy()
        found[:, [KP, KD]] = scale * self.nominal[:, [KP, KD]]
        found[:, PLAY] *= play
        return found

    def angles(self, numbers: Array, shift_rad: Array | float = 0.0) -> Array:
        """What is compared, in a world with these numbers and starts, shape (N, K)."""
        shown = self.limb.simulate(numbers, shift=shift_rad)
        return np.nan_to_num(self._compared(shown), nan=DIVERGED_RAD)

    def _compared(self, shown: Array) -> Array:
        return np.where(self.by_motor, shown[:, 1], shown[:, 0])

    def _around(self, joints: Sequence[int], rng: np.random.Generator) -> tuple[Array, Array]:
        """Logarithms of gains around the last ones (W, K, 2), and what they show (W, N, K)."""
        shape = AROUND, len(self.scale)
        play = rng.uniform(1 - JITTER_PLAY, 1 + JITTER_PLAY, shape)
        start = self.limb.nominal[:, PLAY] * rng.uniform(-JITTER_START, JITTER_START, shape)
        points = np.zeros((*shape, 2))
        points[:, joints] = (
            NEAR_STD * rng.standard_normal((AROUND, len(joints), 2)) @ TO_LOG_GAINS.T
        )
        rows = zip(points, play, start, strict=True)
        shown = [self.angles(self.numbers(self.scale * np.exp(g), p), s) for g, p, s in rows]
        return points, np.stack(shown)


def gains(
    nominal: Spec, world: Spec, log: Log, rng: np.random.Generator
) -> tuple[dict[str, Gains | str], tuple[GainFit, ...]]:
    """The gains of every joint, or why the log does not tell them; and the fits of all limbs.

    `world`: the nominal one with the play and the gains that were found so far. Raises LogError.
    """
    found, fits = dict[str, Gains | str](), list[GainFit]()
    for part, plain in zip(limbs(world), limbs(nominal), strict=True):
        limb = Limb(spec=part, recordings=excerpted(log, part, FITTED_S)[0], rigid=False)
        reasons = [reason_against(limb, j) for j in range(len(limb.joints))]
        one = GainFit(limb, plain)
        one.run([j for j, reason in enumerate(reasons) if not reason], rng)
        worlds = one.nominal, one.numbers(one.scale)
        errors = np.stack([np.abs(one.angles(numbers) - one.read) for numbers in worlds])
        for j, name in enumerate(limb.joints):
            found[name] = reasons[j] or _result(one, j, errors, rng)
        fits.append(one)
    return {name: found[name] for name in nominal.hand.joint_names}, tuple(fits)


def reason_against(limb: Limb, j: int) -> str:
    """Why a log cannot identify the gains of joint `j`; empty where it may."""
    ends = [np.quantile(m.measured[:, 0, j], (0.01, 0.99)) for m in limb.recordings]
    moved = max(float(high - low) for low, high in ends)
    if moved < LEAST_MOTION_RAD:
        return (
            f"not identifiable from this log: it moves by {np.degrees(moved):.2g} deg in free air; "
            f"needed: {np.degrees(LEAST_MOTION_RAD):g} deg"
        )
    if (count := len(limb.measured)) < LEAST_BLOCKS:
        return f"not identifiable from this log: {count} readings; needed: {LEAST_BLOCKS}"
    return ""


def _result(one: GainFit, j: int, errors_rad: Array, rng: np.random.Generator) -> Gains | str:
    """The gains of a joint; errors (2, N, K) are those of the nominal world and with them."""
    used = one.used[:, j]
    if not used.any():
        return FLOATS
    draws = np.array([one.draw[j](rng) for _ in range(DRAWS)])
    std, means = draws.std(axis=0, ddof=1), one.numbers(one.scale)[j, [KP, KD]]
    for name, ratio, sd, (low, high) in zip(("kp", "kd"), one.scale[j], std, SCALES, strict=True):
        if not low < ratio < high:
            return (
                f"not identifiable from this log: its {name} runs to the limit of the search, "
                f"{low:g} to {high:g} times the nominal one"
            )
        if not sd < LARGEST_STD:
            return (
                f"not identifiable from this log: its motion leaves {name} open by "
                f"{100 * sd:.0f} %; allowed: {100 * LARGEST_STD:.0f} %"
            )
    sizes = zip(means, std, one.scale[j], strict=True)
    before, after = 1e3 * errors_rad[:, used, j].mean(axis=1)
    kp, kd = (Gain(mean=mean, std=mean * sd, relative=ratio - 1) for mean, sd, ratio in sizes)
    return Gains(
        kp_nm_rad=kp,
        kd_nms_rad=kd,
        correlation=float(np.corrcoef(draws.T)[0, 1]),
        compared="motor" if one.by_motor[j] else "position",
        samples=int(used.sum()),
        error_nominal_mrad=before,
        error_calibrated_mrad=after,
        confounded=tuple(confusions(one, j)),
    )


def confusions(one: GainFit, j: int) -> Iterator[str]:
    """The effects on a joint, at their smallest levels, that look like other gains, in words."""
    spec, used, best = one.limb.spec, one.used[:, j], one.numbers(one.scale)
    here, body, gains = one.angles(best)[used, j], spec.hand.driven[j], best[:, [KP, KD]]

    def trace(numbers: Array) -> Array:
        return one.angles(numbers)[used, j] - here

    steps = []
    for place in (KP, KD):
        numbers = best.copy()
        numbers[j, place] *= 1.0 + STEP
        steps.append(trace(numbers) / STEP)
    columns = np.stack(steps, axis=1)
    for name, kind in catalogue().items():
        number = kind.number if kind.per_joint and issubclass(kind, NumberEffect) else ""
        if number not in COLUMNS or COLUMNS.index(number) in (KP, KD) or kind.refusal(body):
            continue
        size = kind.levels[0] * kind.natural(spec.drives[j])
        numbers = table(kind(magnitude=size, joint=one.limb.joints[j]).on_spec(spec), rigid=False)
        numbers[:, [KP, KD]] = gains
        path = trace(numbers)
        x, total = np.linalg.lstsq(columns, path)[0], float(path @ path)
        share = 1 - float(np.sum((path - columns @ x) ** 2)) / total if total > 0 else 0.0
        if share > SHARE and np.abs(x).max() > LEAST:
            kp, kd = 100 * x
            yield (
                f"{name}: {size / UNITS[kind.unit][1]:.3g} {kind.unit} would look like "
                f"kp {kp:+.1f} %, kd {kd:+.1f} % ({100 * share:.1f} % of it)"
            )
