"""Calibration of a log: play, then gains with that play, then play with those gains.

The push test subtracts the motor's own motion. Without a motor encoder this motion is replayed and
depends on the gains, while the replay for the gains needs the play. So the play is measured again
whenever the gains are better known: after a fit to an excerpt, and after that to all.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from diagnosis.calibration import gains
from diagnosis.calibration.backlash import Play, lock_of, push_test
from diagnosis.calibration.confounded import confusions
from diagnosis.calibration.result import Backlash, Gain, Gains, Joint
from diagnosis.calibration.tactile import TouchSensor, calibrate_touch
from diagnosis.logs.log import Log, LogError
from diagnosis.motion.batch import Simulate, replay
from diagnosis.motion.excerpt import excerpt
from diagnosis.motion.recordings import Recording, recordings
from diagnosis.triage.triage import triage

EXCERPTS_S, ROUNDS = (100.0, 400.0), (12, 3)
"""Joint-seconds without pushes that gains are fitted to, first and last, and rounds at most: twelve
steps go from nominal gains to any that is tried."""
YES = 0.5
"""Threshold of readings that are 0 or 1."""
TOTAL = sum(ROUNDS)
"""Number of progress steps that are reported."""
FLOATS = (
    "not identifiable from this log: it floats between its teeth nearly all the time; log its "
    "motor's angle, or move it faster"
)
LARGEST_STD = 0.3
"""A gain with a larger relative standard deviation is not identified."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The calibration that a log gives; where it gives none, a reason instead of a number."""

    nominal: Spec
    calibrated: Spec
    """The nominal world with the identified gains, play and locks."""
    joints: dict[str, Joint]
    touch: dict[str, TouchSensor] | str
    touch_unit: str
    """Unit of the taxels' readings: m, or 1 for contact or none."""
    motions: tuple[Recording, ...]
    """Episodes, or parts of them, to which gains were fitted, and one with pushes."""


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
    found = recordings(log, nominal)
    if strange := [name for name in log.joints if name not in names]:
        raise LogError(
            f"this log has joints that its mechanism lacks: {', '.join(strange)}; known: "
            f"{', '.join(names)}; drop their columns"
        )
    triage(log, nominal)
    pushes = [motion for motion in found if motion.push.any()]
    fitted, world = _gains(simulate, nominal, found, pushes, rng, progress)
    plays = push_test(simulate, world, pushes)
    taxels = nominal.hand.taxels
    return Calibration(
        nominal=nominal,
        calibrated=_with_plays(world, plays),
        joints={
            name: Joint(
                gains=fitted[name], backlash=Backlash.of(play) if isinstance(play, Play) else play
            )
            for name, play in plays.items()
        },
        touch=calibrate_touch(
            log, (taxels.rows, taxels.columns), YES if log.is_binary else threshold_m
        ),
        touch_unit="1" if log.is_binary else "m",
        motions=_telling(found, EXCERPTS_S[-1]),
    )


def _telling(found: Sequence[Recording], enough_s: float) -> tuple[Recording, ...]:
    """An excerpt of so many joint-seconds of the motions, and the first push whose torque is known.

    Pushes fix the scale of all torques.
    """
    moved = [motion for motion in found if motion.protocol != "push"]
    pushed = [motion for motion in found if motion.protocol == "push" and motion.push.any()]
    return (*(excerpt(moved, enough_s) if moved else ()), *pushed[:1])


def _gains(
    simulate: Simulate,
    nominal: Spec,
    found: Sequence[Recording],
    pushes: Sequence[Recording],
    rng: np.random.Generator,
    progress: gains.Progress,
) -> tuple[dict[str, Gains | str], Spec]:
    """The gains by joint, and the nominal world with play and the identified gains."""
    names, free = nominal.hand.joint_names, _telling(found, EXCERPTS_S[-1])
    world = _with_plays(nominal, push_test(simulate, nominal, pushes))
    reasons = {j: gains.reason_against(free, j) for j in range(len(names))}
    joints = [j for j, reason in reasons.items() if reason is None]
    if not joints:
        return {names[j]: reason or "" for j, reason in reasons.items()}, world
    some, scale = _telling(found, EXCERPTS_S[0]), np.ones((len(names), 2))
    first, _ = gains.fit(simulate, world, scale, some, joints, rng, ROUNDS[0], progress)
    for j, fit in first.items():
        scale[j] = fit.scale
    world = _with_plays(nominal, push_test(simulate, gains.with_gains(world, scale), pushes))
    fits, compared = gains.fit(
        simulate, world, scale, free, joints, rng, ROUNDS[1], lambda k: progress(ROUNDS[0] + k)
    )
    samples = compared.used.sum(axis=0)
    for j in joints:
        reasons[j] = _reason_against(fits[j]) if j in fits else FLOATS
    joints = [j for j in joints if reasons[j] is None]
    scale = np.ones((len(names), 2))
    for j in joints:
        scale[j] = fits[j].scale
    best = gains.with_gains(world, scale)
    confused = confusions(simulate, best, free, compared, joints)
    errors = compared.errors(replay(simulate, [nominal, best], free), free).sum(axis=1)
    errors_mrad = 1e3 * errors / np.maximum(samples, 1)
    return {
        names[j]: reason
        or Gains(
            kp_nm_rad=_gain(nominal.drives[j].kp_nm_rad, 0, fits[j]),
            kd_nms_rad=_gain(nominal.drives[j].kd_nms_rad, 1, fits[j]),
            correlation=fits[j].correlation,
            compared="motor" if compared.is_motor[j] else "position",
            samples=int(samples[j]),
            error_nominal_mrad=errors_mrad[0, j],
            error_calibrated_mrad=errors_mrad[1, j],
            confounded=confused[j],
        )
        for j, reason in reasons.items()
    }, best


def _gain(nominal: float, k: int, fit: gains.GainFit) -> Gain:
    """A gain, kp or kd (0 or 1)."""
    mean = nominal * fit.scale[k]
    return Gain(mean=mean, std=mean * fit.std[k], relative=fit.scale[k] - 1)


def _reason_against(fit: gains.GainFit) -> str | None:
    """The reason why a fit is not accepted, if there is one."""
    both = zip(("kp", "kd"), fit.scale, fit.std, gains.SCALES, strict=True)
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
