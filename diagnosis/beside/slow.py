"""Logs that are slower than their drives: what joints do between two rows is not known.

When a target or a push came, and how a drive set off, is lost within a row. Where a joint rests
shows all the same, so only that is compared.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.spec import Drive
from backends.state import Array
from diagnosis.attribution.evidence import Evidence, Recording
from diagnosis.attribution.gather import LEAST_SAMPLES

SLOW = 2.0
"""A log is slow where a row takes more than so many time constants of a drive."""
RUN, STILL = 3, 2.0
"""At rest, so many readings in a row are within so many standard deviations of each other."""
ANSWERED = 10.0
"""Rows in a time constant that show how a drive answers."""


def is_slow(part: Evidence) -> bool:
    """Whether rows come too seldom for the drives of a limb."""
    return _row_s(part) > SLOW * max(map(_time_constant_s, part.nominal.drives))


def at_rest(part: Evidence) -> Evidence:
    """Evidence of a slow log without the samples at which a joint moves, where enough remain."""
    if not is_slow(part):
        return part
    recordings = tuple(_resting(r, STILL * part.sigma[0, 0]) for r in part.recordings)
    left = sum(int(np.isfinite(r.measured[0]).any(axis=1).sum()) for r in recordings)
    return replace(part, recordings=recordings) if left >= LEAST_SAMPLES else part


def unjudged(parts: Sequence[Evidence]) -> tuple[str, ...]:
    """What a slow log does not tell, and what to record."""
    slow = [part for part in parts if is_slow(part)]
    if not slow:
        return ()
    joints = ", ".join(joint for part in slow for joint in part.joints)
    drive_s = min(_time_constant_s(drive) for part in slow for drive in part.nominal.drives)
    return (
        f"the motion of {joints}, only its rests: a row takes {1e3 * _row_s(slow[0]):.0f} ms and a "
        f"drive answers within {1e3 * drive_s:.0f} ms; record a row every "
        f"{1e3 * drive_s / ANSWERED:.1g} ms",
    )


def _row_s(part: Evidence) -> float:
    return part.sample_s / part.stride


def _time_constant_s(drive: Drive) -> float:
    """How long a drive takes to answer: overdamped, or without damping a part of its swing."""
    swing_s = np.sqrt(drive.rotor_inertia_kgm2 / drive.kp_nm_rad)
    return max(drive.kd_nms_rad / drive.kp_nm_rad, float(swing_s))


def _resting(recording: Recording, within: Array) -> Recording:
    """A recording without the readings of joints that move, or have not yet set off to a target.

    At rest they are within so much of each other (J,).
    """
    runs = np.lib.stride_tricks.sliding_window_view(recording.measured[0], RUN, axis=0)
    still = np.ptp(runs, axis=-1) <= within
    rests = np.zeros(recording.measured[0].shape, dtype=bool)
    for k in range(RUN):
        rests[k : k + len(still)] |= still
    target = recording.commands.target
    arrived = _last(~rests) >= _last(np.diff(target, axis=0, prepend=target[:1]) != 0.0)
    return replace(recording, measured=np.where(rests & arrived, recording.measured, np.nan))


def _last(events: Array) -> Array:
    """The row of the last event so far, bool (T, J) to numbers; -1 before the first."""
    rows = np.arange(len(events))[:, None]
    return np.maximum.accumulate(np.where(events, rows, -1), axis=0)
