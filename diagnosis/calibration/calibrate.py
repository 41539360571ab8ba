"""Calibration of a log: play, then gains with that play, then play with those gains.

The push test subtracts the motor's own motion. Without a motor encoder this motion is replayed and
depends on the gains, while the replay for the gains needs the play. So the play is measured again
whenever the gains are better known: after the search and at the end.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.calibration import gains
from diagnosis.calibration.backlash import Play, lock_of, push_test
from diagnosis.calibration.refine import ROUNDS, Refined, refine
from diagnosis.calibration.spread import Spread, spreads
from diagnosis.calibration.tactile import TouchSensor, calibrate_touch
from diagnosis.calibration.worlds import Motion, motions, replay
from diagnosis.logs.log import Log, LogError
from diagnosis.motion.batch import Simulate
from diagnosis.motion.recordings import LEAST_S as COMPARED_S
from diagnosis.triage.triage import triage

FREE_AIR = ("steps", "multisine", "triangle", "free", "push")
"""Protocols to which gains are fitted; the push only where its torque is known."""
SEARCH_S, REFINE_S, LEAST_S = 24.0, 72.0, 4.0
"""Duration that a candidate replays in the search and after it, shared by the episodes, each from
its start; and the minimum per episode [s]."""
YES = 0.5
"""Threshold of readings that are 0 or 1."""
TOTAL = gains.GENERATIONS + ROUNDS
"""Number of progress steps that are reported."""
FLOATS = (
    "not identifiable from this log: it floats between its teeth nearly all the time; log its "
    "motor's angle, or move it faster"
)
LARGEST_STD = 0.3
"""A gain with a larger relative standard deviation is not identified."""


@dataclass(frozen=True, kw_only=True)
class JointGains:
    """The gains of one joint."""

    scale: Array
    """kp and kd over nominal, shape (2,)."""
    search: gains.GainFit
    """Result of CMA-ES, from which the linearised replays start."""
    spread: Spread
    channel: int
    """Row of `READINGS` that was compared."""
    samples: int
    """Number of samples that were compared in the end."""
    error_rad: tuple[float, float]
    """Mean absolute error of the compared samples, in the nominal and in the calibrated world."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The calibration that a log gives; where it gives none, a reason instead of a number."""

    nominal: Spec
    calibrated: Spec
    """The nominal world with the identified gains, play and locks."""
    joints: Mapping[str, JointGains | str]
    plays: Mapping[str, Play | str]
    touch: dict[str, TouchSensor] | str
    touch_unit: str
    """Unit of the taxels' readings: m, or 1 for contact or none."""
    motions: tuple[Motion, ...]
    """Episodes, or their beginnings, to which gains were fitted."""
    pushes: tuple[Motion, ...]


def calibrate(
    simulate: Simulate,
    nominal: Spec,
    log: Log,
    threshold_m: float | None,
    rng: np.random.Generator,
    progress: gains.Progress = lambda generations: None,
) -> Calibration:
    """Calibrate `nominal` to a log; raises LogError for another mechanism or faulty data."""
    names = nominal.hand.joint_names
    _same_joints(log, names)
    drive_s = nominal.timing.drive_s
    found = motions(log, names, drive_s, FREE_AIR)
    if drive_s * sum(motion.tick[-1] for motion in found) >= COMPARED_S:
        triage(log, nominal)
    pushes = [motion for motion in found if motion.push_nm.any()]
    moved = [motion for motion in found if motion.protocol != "push" or motion.push_nm.any()]
    free = _shortened(_telling(moved), REFINE_S / drive_s, LEAST_S / drive_s)
    fitted, world = _gains(simulate, nominal, free, pushes, rng, progress)
    plays = push_test(simulate, world, pushes)
    taxels, unit = nominal.hand.taxels, _touch_unit(log)
    level = threshold_m if unit == "m" else YES
    return Calibration(
        nominal=nominal,
        calibrated=_with_plays(world, plays),
        joints=fitted,
        plays=plays,
        touch=calibrate_touch(log, (taxels.rows, taxels.columns), level),
        touch_unit=unit,
        motions=tuple(free),
        pushes=tuple(pushes),
    )


def _gains(
    simulate: Simulate,
    nominal: Spec,
    free: Sequence[Motion],
    pushes: Sequence[Motion],
    rng: np.random.Generator,
    progress: gains.Progress,
) -> tuple[dict[str, JointGains | str], Spec]:
    """The gains by joint, and the nominal world with play and the identified gains."""
    names, drive_s = nominal.hand.joint_names, nominal.timing.drive_s
    world = _with_plays(nominal, push_test(simulate, nominal, pushes))
    against = {j: gains.reason_against(free, j) for j in range(len(names))}
    joints = [j for j, reason in against.items() if reason is None]
    if not joints:
        return {names[j]: reason or "" for j, reason in against.items()}, world
    short = _shortened(free, SEARCH_S / drive_s, LEAST_S / drive_s)
    found = gains.search(simulate, world, short, joints, rng, progress)
    start = _scale(nominal, found)
    plays = push_test(simulate, gains.with_gains(world, start), pushes)
    world = _with_plays(nominal, plays)
    refined = refine(
        simulate, world, start, free, joints, rng, lambda k: progress(gains.GENERATIONS + k)
    )
    best = gains.with_gains(world, refined.scale)
    spread = spreads(simulate, best, free, refined, rng)
    shown = replay(simulate, [nominal, best], free)
    fitted = {
        names[j]: reason or _joint(j, found[j], refined, spread, shown, free)
        for j, reason in against.items()
    }
    sure = [[not isinstance(fitted[name], str)] for name in names]
    return fitted, gains.with_gains(world, np.where(sure, refined.scale, 1.0))


def _joint(
    j: int,
    found: gains.GainFit,
    refined: Refined,
    spread: Mapping[int, Spread],
    shown: Sequence[Array],
    free: Sequence[Motion],
) -> JointGains | str:
    """The gains of joint `j`, or the reason why the fit is not accepted."""
    if j not in refined.linear:
        return FLOATS
    linear = refined.linear[j]
    before, after = gains.errors(shown, free, linear.trace, j)
    return _open(refined.scale[j], spread[j]) or JointGains(
        scale=refined.scale[j],
        search=found,
        spread=spread[j],
        channel=linear.trace.channel,
        samples=len(linear.columns),
        error_rad=(float(before), float(after)),
    )


def _open(scale: Array, spread: Spread) -> str | None:
    """The reason why a fit is not accepted, if there is one."""
    both = zip(("kp", "kd"), scale, spread.std, gains.SCALES, strict=True)
    for name, ratio, std, (low, high) in both:
        if not low < ratio < high:
            return (
                f"not identifiable from this log: its {name} runs to the limit of the search, "
                f"{low:g} to {high:g} times the nominal one"
            )
        if not std < LARGEST_STD:
            return (
                f"not identifiable from this log: its motion leaves {name} open by "
                f"{100 * std:.0f} %; allowed: {100 * LARGEST_STD:.0f} %"
            )
    return None


def _scale(spec: Spec, found: Mapping[int, gains.GainFit]) -> Array:
    scale = np.ones((len(spec.drives), 2))
    for j, gain in found.items():
        scale[j] = gain.scale
    return scale


def _with_plays(spec: Spec, plays: Mapping[str, Play | str]) -> Spec:
    """The world with the play and the lock of every joint that the push test identifies."""
    drives = []
    for name, drive in zip(spec.hand.joint_names, spec.drives, strict=True):
        play = plays[name]
        if isinstance(play, Play):
            lock_nm = max(drive.lock_nm, lock_of(drive)) if play.locks else 0.0
            half_rad = play.mean_rad if play.has_play else 0.0
            drive = dataclasses.replace(drive, play_rad=half_rad, lock_nm=lock_nm)
        drives.append(drive)
    return spec.with_drives(drives)


def _same_joints(log: Log, names: Sequence[str]) -> None:
    missing = [name for name in names if name not in log.joints]
    strange = [name for name in log.joints if name not in names]
    if missing:
        raise LogError(f"this log has no columns for {', '.join(missing)}; record every joint")
    if strange:
        raise LogError(
            f"this log has joints that its mechanism lacks: {', '.join(strange)}; known: "
            f"{', '.join(names)}; drop their columns"
        )


def _telling(found: Sequence[Motion]) -> list[Motion]:
    """The first motion of each protocol, and later ones that move other joints."""
    kept: list[Motion] = []
    seen: set[tuple[str, int]] = set()
    for motion in found:
        moved = np.flatnonzero(np.ptp(motion.command_rad, axis=0) > gains.LEAST_MOTION_RAD)
        places = {(motion.protocol, int(j)) for j in moved}
        if places - seen or motion.protocol not in {k.protocol for k in kept}:
            kept.append(motion)
        seen |= places
    return kept


def _shortened(found: Sequence[Motion], ticks: float, least: float) -> list[Motion]:
    """The beginnings of the motions, with this number of drive periods in total."""
    return [motion.first(round(max(ticks / len(found), least))) for motion in found]


def _touch_unit(log: Log) -> str:
    channel = log.meta.channels.get("touch")
    return channel.unit if channel else "m"
