"""The nominal world of a user's robot, from its MJCF and drive settings."""

from collections.abc import Mapping

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from diagnosis.logs.log import Log, LogError, MjcfMechanism

FREE_LIMIT = 2.0
"""A drive without a limit gets this multiple of the torque at the log's largest error."""
OWN_BOUNDS = {
    "torque": ("torque_limit_nm", 0.8),
    "damping": ("kd_nms_rad", 0.9),
    "inertia": ("rotor_inertia_kgm2", 10.0),
}
"""By dimension, the drive's number that bounds an effect, and the share of it: a hand's bounds."""


def mjcf_world(log: Log) -> Spec:
    """The nominal world of a log with an MJCF mechanism; raises LogError if it cannot be built."""
    from backends.mjcf import MjcfError, mechanism

    xml, settings = _parts(log)
    servos = {
        name: servo
        if servo.limit is not None or name not in log.joints
        else servo.model_copy(update={"limit": _ample(log, name, servo.kp)})
        for name, servo in settings.joints.items()
    }
    try:
        spec = mechanism(xml, servos)
    except MjcfError as error:
        raise LogError(f"{settings.mjcf}: {error}") from None
    for body in spec.hand.driven:
        _fits(log, body.joint.name, body.joint.slides)
    return spec


def left_out(log: Log) -> tuple[str, ...]:
    """What the log's MJCF has and the nominal world lacks, in words; raises LogError."""
    from backends.mjcf import MjcfError, left_out

    xml, settings = _parts(log)
    read = {joint: log.samples[log.column("position", joint)] for joint in log.joints}
    try:
        return left_out(xml, {j: (float(q.min()), float(q.max())) for j, q in read.items()})
    except MjcfError as error:
        raise LogError(f"{settings.mjcf}: {error}") from None


def own_catalogue(catalogue: Mapping[str, type[Effect]], nominal: Spec) -> dict[str, type[Effect]]:
    """The catalogue with bounds scaled to this mechanism.

    An effect may be as large relative to this mechanism as to a hand. Bounds are never narrowed.
    Shares, times and angles mean the same on every mechanism.
    """
    largest = {
        dimension: share * max(getattr(drive, number) for drive in nominal.drives)
        for dimension, (number, share) in OWN_BOUNDS.items()
    }
    return {name: _widened(kind, largest) for name, kind in catalogue.items()}


def _widened(kind: type[Effect], largest: Mapping[str, float]) -> type[Effect]:
    low, high = kind.bounds
    most = largest.get(kind.dimension, 0.0)
    if most <= high:
        return kind
    return type(kind.__name__, (kind,), {"__module__": kind.__module__, "bounds": (low, most)})


def _parts(log: Log) -> tuple[str, MjcfMechanism]:
    settings = log.meta.mechanism
    if not isinstance(settings, MjcfMechanism) or log.mjcf_xml is None:
        raise LogError("this log's mechanism is a hand known by name, not an MJCF file")
    return log.mjcf_xml, settings


def _ample(log: Log, joint: str, kp: float) -> float:
    """A limit that the log never reaches; at least 1e-6 Nm."""
    error = log.samples[log.column("command", joint)] - log.samples[log.column("position", joint)]
    return max(FREE_LIMIT * kp * float(np.abs(error).max()), 1e-6)


def _fits(log: Log, joint: str, slides: bool) -> None:
    """Raise LogError unless a joint is in the log, in metres where it slides."""
    if joint not in log.joints:
        raise LogError(
            f"this log has no commands for '{joint}'; it has: {', '.join(log.joints)}; record "
            "every joint of the MJCF, or delete the joint there, so that its body is fixed"
        )
    if log.is_linear(joint) != slides:
        is_, unit = ("slides", "m") if slides else ("turns", "rad")
        raise LogError(
            f"joint '{joint}' {is_} in the MJCF, so its columns must be in {unit}; the log has "
            f"'{log.column('command', joint)}'; rename and convert them, or mend the joint's type"
        )
