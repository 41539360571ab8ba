"""Calibration of a log: play, then gains with that play, then play with those gains.

The push test subtracts the motor's own motion. Without a motor encoder this motion is replayed and
depends on the gains, while the replay for the gains needs the play. So both are measured twice.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from backends.spec import Spec
from diagnosis.calibration.backlash import Play, lock_of, push_test
from diagnosis.calibration.gains import GainFit, gains
from diagnosis.calibration.result import Backlash, Gains, Joint
from diagnosis.calibration.tactile import TouchSensor, calibrate_touch
from diagnosis.logs.log import Log, LogError
from diagnosis.motion.batch import Simulate
from diagnosis.motion.columns import with_numbers
from diagnosis.motion.recordings import recordings
from diagnosis.triage.triage import triage

ROUNDS = 2
"""How often play and gains are measured: the progress steps that are reported."""


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The calibration that a log gives; where it gives none, a reason instead of a number."""

    calibrated: Spec
    """The nominal world with the identified gains, play and locks."""
    joints: dict[str, Joint]
    touch: dict[str, TouchSensor] | str
    touch_unit: str
    """Unit of the taxels' readings: m, or 1 for contact or none."""
    fits: tuple[GainFit, ...]
    """The fits of gains, by limb."""


def calibrate(
    simulate: Simulate,
    nominal: Spec,
    log: Log,
    threshold_m: float | None,
    rng: np.random.Generator,
    progress: Callable[[int], None] = lambda rounds: None,
) -> Calibration:
    """Calibrate `nominal` to a log; raises LogError for another mechanism or faulty data.

    `simulate` puts worlds with pushes on the nominal engine; `progress` takes finished `ROUNDS`.
    """
    names, found = nominal.hand.joint_names, recordings(log, nominal)
    if strange := [name for name in log.joints if name not in names]:
        raise LogError(
            f"this log has joints that its mechanism lacks: {', '.join(strange)}; known: "
            f"{', '.join(names)}; drop their columns"
        )
    triage(log, nominal)
    pushes, world = [motion for motion in found if motion.push.any()], nominal
    for done in range(ROUNDS):
        world = _with_plays(world, push_test(simulate, world, pushes))
        fitted, fits = gains(nominal, world, log, rng)
        world = _with_gains(world, fitted, nominal)
        progress(done + 1)
    plays, taxels = push_test(simulate, world, pushes), nominal.hand.taxels
    threshold = 0.5 if log.is_binary else threshold_m  # binary readings are 0 or 1
    return Calibration(
        calibrated=_with_plays(world, plays),
        joints={
            name: Joint(
                gains=fitted[name], backlash=Backlash.of(play) if isinstance(play, Play) else play
            )
            for name, play in plays.items()
        },
        touch=calibrate_touch(log, (taxels.rows, taxels.columns), threshold),
        touch_unit="1" if log.is_binary else "m",
        fits=fits,
    )


def _with_plays(spec: Spec, plays: Mapping[str, Play | str]) -> Spec:
    """The world with the play and the lock of every joint that the push test identifies."""
    numbers = {}
    for name, drive in zip(spec.hand.joint_names, spec.drives, strict=True):
        if isinstance(play := plays[name], Play):
            numbers[name] = {
                "drive.play_rad": play.mean_rad if play.has_play else 0.0,
                "drive.lock_nm": max(drive.lock_nm, lock_of(drive)) if play.locks else 0.0,
            }
    return with_numbers(spec, numbers)


def _with_gains(spec: Spec, fitted: Mapping[str, Gains | str], nominal: Spec) -> Spec:
    """The world with the gains that are identified, the others nominal."""
    numbers = {}
    for (name, one), drive in zip(fitted.items(), nominal.drives, strict=True):
        kp, kd = drive.kp_nm_rad, drive.kd_nms_rad
        if isinstance(one, Gains):
            kp, kd = one.kp_nm_rad.mean, one.kd_nms_rad.mean
        numbers[name] = {"drive.kp_nm_rad": kp, "drive.kd_nms_rad": kd}
    return with_numbers(spec, numbers)
