"""The texts of a calibration: the calibrated world, its spread, and a table."""

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table
from rich.text import Text

from backends.effect import Effect
from backends.spec import Spec
from benchmark.settings.effects import PAPER_SPREAD, effect_text
from diagnosis.calibration.calibrate import Calibration
from diagnosis.calibration.result import Backlash, CalibrationFile, Gains

_SET = {
    *("drive.play_rad", "drive.lock_nm", "drive.kp_nm_rad", "drive.kd_nms_rad"),
    *("taxels.dead_share", "taxels.drift_m_s"),
}
"""Numbers that a calibration sets itself; effects of the nominal world on them are replaced."""
_GAINS = ("kp-scale", "kd-scale")


def effects_text(found: Calibration, ideal: Spec, known: Sequence[Effect]) -> str:
    """The calibrated world as effects on the ideal hand; `known`: those of the nominal world."""
    kept = [effect_text(e, ideal) for e in known if not _SET.issuperset(e.spec_fields())]
    joints = [item for name in ideal.hand.joint_names for item in _joint(found, ideal, name)]
    return ",".join([*kept, *joints, *_skin(found)]) or "none"


def spread_text(found: Calibration) -> str:
    """Domain randomisation: gains by their standard deviations, the rest as in the paper."""
    paper = dict(item.split("=") for item in PAPER_SPREAD.split(","))
    items = []
    for name, joint in found.joints.items():
        for k, gain in enumerate(_GAINS):
            size = paper[gain]
            if isinstance(joint.gains, Gains):
                fit = (joint.gains.kp_nm_rad, joint.gains.kd_nms_rad)[k]
                size = f"{100 * fit.std / fit.mean:.3g}%"
            items.append(f"{gain}={size}@{name}")
    return ",".join([*items, *(f"{k}={v}" for k, v in paper.items() if k not in _GAINS)])


def table(content: CalibrationFile) -> Table:
    """A row per joint with gains, errors and play; below it confounded effects and touch."""
    below = Text("\n".join([*_confounded(content), *_touch(content)]))
    shown = Table(header_style="bold", caption=below, caption_justify="left")
    for column in (
        "joint",
        "kp, Nm/rad",
        "kd, Nms/rad",
        "error, mrad",
        "backlash, deg",
        "lock",
    ):
        shown.add_column(column, overflow="fold")
    for name, joint in content.joints.items():
        gains, play = joint.gains, joint.backlash
        row = [name]
        if isinstance(gains, Gains):
            row += [
                f"{g.mean:.4g} +- {g.std:.2g} ({100 * g.relative:+.1f} %)"
                for g in (gains.kp_nm_rad, gains.kd_nms_rad)
            ]
            row += [f"{gains.error_nominal_mrad:.3g} -> {gains.error_calibrated_mrad:.3g}"]
        else:
            row += [gains, "-", "-"]
        if isinstance(play, Backlash):
            std = "?" if play.std_deg is None else f"{play.std_deg:.2g}"
            row += [f"{play.half_deg:.3f} +- {std}", "yes" if play.self_lock else "no"]
        else:
            row += [play, "-"]
        shown.add_row(*row)
    return shown


def _confounded(content: CalibrationFile) -> Iterator[str]:
    for name, joint in content.joints.items():
        if isinstance(joint.gains, Gains):
            yield from (
                f"{name}, cannot be distinguished: {what}" for what in joint.gains.confounded
            )


def _touch(content: CalibrationFile) -> Iterator[str]:
    if isinstance(content.tactile, str):
        yield f"touch: {content.tactile}"
        return
    for finger, skin in content.tactile.items():
        yield (
            f"{finger}: threshold {skin.threshold:.3g}, {100 * skin.false_share:.2g} % of the "
            f"readings without contact above it, fastest drift {skin.fastest_drift_s:.3g}/s, "
            f"{len(skin.dead)} of {skin.touched} touched taxels dead"
        )


def _joint(found: Calibration, ideal: Spec, name: str) -> Iterator[str]:
    """The effects of one joint, where it differs from the ideal one."""
    j = ideal.hand.joint_names.index(name)
    drive, plain = found.calibrated.drives[j], ideal.drives[j]
    if drive.play_rad > 0:
        yield f"backlash={np.degrees(drive.play_rad):.3f}deg@{name}"
    if drive.lock_nm > 0:
        yield f"self-lock={drive.lock_nm:g}Nm@{name}"
    ratios = (drive.kp_nm_rad / plain.kp_nm_rad, drive.kd_nms_rad / plain.kd_nms_rad)
    for gain, ratio in zip(_GAINS, ratios, strict=True):
        if abs(ratio - 1) > 1e-9:
            yield f"{gain}={100 * (ratio - 1):+.2f}%@{name}"


def _skin(found: Calibration) -> Iterator[str]:
    if isinstance(found.touch, str) or not found.touch:
        return
    skins = list(found.touch.values())
    touched, dead = sum(s.touched for s in skins), sum(len(s.dead) for s in skins)
    fastest = max(s.fastest_drift_s for s in skins)
    if dead:
        yield f"taxel-dropout={100 * dead / touched:.3g}%"
    if fastest > 0 and found.touch_unit == "m":
        yield f"taxel-drift={1e3 * fastest:.3g}mm/s"
