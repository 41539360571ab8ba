"""The nominal world of a user's robot, from its MJCF and drive settings."""

from collections.abc import Mapping

from backends.effect import Effect
from backends.spec import Spec
from diagnosis.logs.log import Log, LogError, as_log_errors
from diagnosis.replay.robot import model_of, servos

OWN_BOUNDS = {
    "torque": ("torque_limit_nm", 0.8),
    "damping": ("kd_nms_rad", 0.9),
    "inertia": ("rotor_inertia_kgm2", 10.0),
}
"""By dimension, the drive's number that bounds an effect, and the share of it: a hand's bounds."""

ROOM = 2.0
"""A joint without limits may go so many times further than a log of it does."""


def mjcf_world(log: Log, geared: bool = False) -> Spec:
    """The nominal world of a log with an MJCF mechanism; raises LogError if it cannot be built.

    `geared`: its drives are simulated with gears, as engines do.
    """
    from backends.mjcf import mechanism

    xml, settings = model_of(log)
    with as_log_errors(f"{settings.mjcf}: "):
        spec = mechanism(
            xml,
            servos(log),
            held=settings.hold,
            fix_base=settings.fix_base,
            carried=settings.gravity_compensation,
            geared=geared,
            room={joint: ROOM * _farthest(log, joint) for joint in log.joints},
        )
    for body in spec.hand.driven:
        joint, slides = body.joint.name, body.joint.slides
        if log.is_linear(joint) != slides:
            is_, unit = ("slides", "m") if slides else ("turns", "rad")
            column = log.column("command", joint)
            raise LogError(
                f"joint '{joint}' {is_} in the MJCF, so its columns must be in {unit}; the log has "
                f"'{column}'; rename and convert them, or mend the joint's type"
            )
    return spec


def _farthest(log: Log, joint: str) -> float:
    """How far from zero a joint or its target goes [rad or m]."""
    columns = [log.column(kind, joint) for kind in ("command", "position")]
    return float(log.samples[columns].abs().max(axis=None))


def left_out(log: Log) -> tuple[str, ...]:
    """What the log's MJCF has and the nominal world lacks, in words; raises LogError."""
    from backends.mjcf import left_out

    xml, settings = model_of(log)
    read = {joint: log.samples[log.column("position", joint)] for joint in log.joints}
    with as_log_errors(f"{settings.mjcf}: "):
        return left_out(xml, {j: (float(q.min()), float(q.max())) for j, q in read.items()})


def own_catalogue(catalogue: Mapping[str, type[Effect]], nominal: Spec) -> dict[str, type[Effect]]:
    """The catalogue with bounds scaled to this mechanism.

    An effect may be as large relative to this mechanism as to a hand. Bounds are never narrowed.
    Shares, times and angles mean the same on every mechanism; of a joint's range all of it counts.
    """
    largest = {
        dimension: share * max(getattr(drive, number) for drive in nominal.drives)
        for dimension, (number, share) in OWN_BOUNDS.items()
    }
    ranges = (body.joint.range_rad for body in nominal.hand.driven)
    room = max(high - low for low, high in ranges)
    return {
        name: _widened(kind, room if kind.coordinate == "reach" else largest.get(kind.dimension, 0))
        for name, kind in catalogue.items()
    }


def _widened(kind: type[Effect], most: float) -> type[Effect]:
    low, high = kind.bounds
    if most <= high:
        return kind
    wide = (-most if low < 0.0 else low), most
    return type(kind.__name__, (kind,), {"__module__": kind.__module__, "bounds": wide})
