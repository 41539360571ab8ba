"""Check whether the numbers of a log can belong to the mechanism that it names.

Command and position that are both in degrees agree with each other but with no joint. A push in Nmm
agrees with nothing else in the log. The bounds are far beyond what a joint or a push test does.
"""

import numpy as np

from backends.spec import Joint, Spec
from diagnosis.logs.log import Log, LogError

WIDTHS = 1.0
"""A joint may be beyond either end of its range by this multiple of the range."""
LIMITS = 50.0
"""Largest push as a multiple of the drive's largest torque."""


def check_units(log: Log, nominal: Spec) -> None:
    """Raise LogError if angles or pushes are certainly in wrong units."""
    for body, drive in zip(nominal.hand.driven, nominal.drives, strict=True):
        for kind in ("command", "position"):
            _check_angle(log, kind, body.joint)
        if log.has("push", body.joint.name):
            _check_push(log, body.joint.name, drive.torque_limit_nm)


def _check_angle(log: Log, kind: str, joint: Joint) -> None:
    low, high = joint.range_rad
    room = WIDTHS * (high - low)
    if not 0 < room < np.inf:
        return
    column = log.column(kind, joint.name)
    angle = log.samples[column]
    least, most = float(angle.min()), float(angle.max())
    if least < low - room or most > high + room:
        unit, other = ("m", "mm") if joint.slides else ("rad", "degrees")
        raise LogError(
            f"'{column}' goes from {least:.3g} to {most:.3g}; the range of {joint.name} is "
            f"{low:.3g} to {high:.3g} {unit}: is it in {other}? Convert it to {unit}"
        )


def _check_push(log: Log, joint: str, limit_nm: float) -> None:
    column = log.column("push", joint)
    largest = float(log.samples[column].abs().max())
    if largest > LIMITS * limit_nm:
        raise LogError(
            f"'{column}' reaches {largest:.3g}; its drive gives {limit_nm:.3g} Nm at most, and "
            f"{LIMITS:g} times that is allowed: is it in Nmm? Convert it to Nm"
        )
