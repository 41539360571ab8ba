"""What is wrong with a log itself, before any cause is sought: sensors, samples, torques.

What cannot be used is left out with a note; a log that then says nothing is refused.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from backends.state import Array
from diagnosis.logs.log import LogError
from diagnosis.motion.columns import LIMIT
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import CHANNELS, Recording

STILL_RAD, MOVES_RAD = 2e-3, 2e-2
"""Below this nothing moves; beyond this something must [rad; of a slide a share of its travel]."""
ABSURD_SHARE, ABSURD_NOISE = 0.5, 100.0
"""A sample is absurd that leaves its neighbours by this share of the whole range and by so many
typical steps, for it returns at once."""
BEYOND_LIMIT = 3.0
"""No drive's torque is beyond so many times the limit of its file."""
OPPOSED, UNRELATED = -0.3, 0.1
"""Torques are of the wrong sign below this correlation with what the drive law asks for, and are
noise where they hardly have any."""
STOP_NEAR, STOP_S, STOP_SHARE = 0.01, 0.3, 0.5
"""A joint stands at the end of its range within this share of it, while its target is beyond and it
does not follow; until so long after [s]. Not where that is more than this share of the log."""
TORQUE = CHANNELS.index("torque")


class StillError(LogError):
    """Nothing is asked of a limb: a log says nothing of it."""


def checked(limb: Limb) -> tuple[Limb, tuple[str, ...]]:
    """The limb's log without what cannot be, and notes of it; raises LogError."""
    _require_motion(limb)
    most = BEYOND_LIMIT * limb.nominal[:, LIMIT]
    cleaned = [_cleaned(recording, most) for recording in limb.recordings]
    notes = []
    if count := sum(number for _, number in cleaned):
        notes.append(f"{count} absurd samples of {', '.join(limb.joints)} are left out")
    limb = replace(limb, recordings=tuple(recording for recording, _ in cleaned))
    limb, stopped = _without_stops(limb)
    notes += stopped
    limb, more = _with_plausible_torques(limb)
    return limb, (*notes, *more)


def _require_motion(limb: Limb) -> None:
    """Raise LogError where nothing is asked for."""
    pushed = any(r.push.any() or np.nan_to_num(r.given).any() for r in limb.recordings)
    commanded = max(float(np.ptp(r.command, axis=0).max()) for r in limb.recordings)
    slides = any(body.joint.slides for body in limb.spec.hand.driven)
    if commanded < (0.0 if slides else STILL_RAD) and not pushed:
        raise StillError(
            f"nothing moves in this log: the targets of {', '.join(limb.joints)} stand still and "
            "no joint is pushed; record steps, triangle, multisine, push"
        )


def _cleaned(recording: Recording, most: Array) -> tuple[Recording, int]:
    """The recording with absurd samples as NaN, and how many there are.

    A step's torque peaks in a single sample: absurd are those beyond `most` (K,) [Nm].
    """
    measured, count = recording.measured.copy(), 0
    for c in range(measured.shape[1]):
        for j in range(measured.shape[2]):
            wrong = absurd(measured[:, c, j])
            if c == TORQUE:
                wrong &= np.abs(measured[:, c, j]) > most[j]
            measured[wrong, c, j] = np.nan
            count += int(wrong.sum())
    return (replace(recording, measured=measured), count) if count else (recording, 0)


def _without_stops(limb: Limb) -> tuple[Limb, list[str]]:
    """The limb without readings at the ends of its joints' ranges, where replays go on; and notes.

    Where its model ends a joint no fault shows: no replay has those stops.
    """
    recordings, notes = [replace(r, measured=r.measured.copy()) for r in limb.recordings], []
    for j, body in enumerate(limb.spec.hand.driven):
        stopped = [_at_ends(r, j, body.joint.range_rad, limb.open[j]) for r in recordings]
        share = float(np.concatenate(stopped).mean())
        if 0.0 < share < STOP_SHARE:
            notes.append(
                f"{limb.joints[j]} stands at the end of its range for {100 * share:.2g} % of the "
                "log, with targets beyond it: that is not judged"
            )
            for recording, rows in zip(recordings, stopped, strict=True):
                recording.measured[rows, :, j] = np.nan
    return (replace(limb, recordings=tuple(recordings)), notes) if notes else (limb, [])


def _at_ends(recording: Recording, joint: int, ends: tuple[float, float], is_open: bool) -> Array:
    """Rows (T,) at which a joint stands at an end of its range, and some time after them."""
    command, position = recording.command[:, joint], recording.measured[:, 0, joint]
    near = STOP_NEAR * (ends[1] - ends[0])
    rows = np.zeros(len(command), dtype=bool)
    for side, end in zip((-1.0, 1.0), ends, strict=True):
        past, asked = side * (position - end), side * (command - end)
        asked = np.full(len(asked), np.inf) if is_open else asked
        if np.nanmax(past) < max(near, asked.max() / 2):
            rows |= (asked > 0.0) & (past > -near)
    last_s = np.maximum.accumulate(np.where(rows, recording.time_s, -np.inf))
    return recording.time_s - last_s < STOP_S


def absurd(readings: Array) -> Array:
    """Which of (T,) readings leave both neighbours, and return at once, further than they can."""
    wrong = np.zeros(len(readings), dtype=bool)
    if len(readings) < 5 or not np.isfinite(readings).all():
        return wrong
    low, high = np.quantile(readings, (0.01, 0.99))
    before, after = readings[1:-1] - readings[:-2], readings[1:-1] - readings[2:]
    typical = float(np.median(np.abs(np.diff(readings))))
    far = max(ABSURD_SHARE * (high - low), ABSURD_NOISE * typical, 1e-9)
    leaves = np.minimum(np.abs(before), np.abs(after)) > far
    wrong[1:-1] = leaves & (before * after > 0)
    return wrong


def _torques(limb: Limb) -> Iterator[tuple[Limb, Array]]:
    """The limb with torques read until and from their samples, and what nominal drives show.

    Our own simulators' are of the period until then.
    """
    for torque_from in (False,) if limb.exact else (False, True):
        read = limb.with_torque_from(torque_from)
        yield read, read.simulate(limb.nominal)[:, TORQUE]


def _distance(shown: Array, measured: Array) -> float:
    """How far torques (N, K) are apart, each joint's over its own largest."""
    most = np.nanmax(np.abs(measured), axis=0, initial=1e-12)
    return float(np.nansum(((shown - measured) / most) ** 2))


def _with_plausible_torques(limb: Limb) -> tuple[Limb, Sequence[str]]:
    """The limb, as its torques were read, without those that cannot be its drives'."""
    measured = limb.measured[:, TORQUE]
    limb, shown = min(_torques(limb), key=lambda pair: _distance(pair[1], measured))
    command = np.concatenate([r.command for r in limb.recordings])
    notes, drop = [], []
    for j, name in enumerate(limb.joints):
        both = np.isfinite(measured[:, j]) & np.isfinite(shown[:, j])
        if both.sum() < 10 or np.std(shown[both, j]) == 0.0:
            continue
        what = ""
        if np.std(measured[both, j]) > 0.0:
            alike = float(np.corrcoef(measured[both, j], shown[both, j])[0, 1])
            if alike < UNRELATED:
                what = "of the wrong sign" if alike < OPPOSED else "noise"
        elif np.ptp(command[:, j]) > MOVES_RAD:
            what = "the same throughout"
        if what:
            drop.append(j)
            notes.append(f"the torque of {name} is {what} and left out")
    if not drop:
        return limb, notes
    recordings = []
    for recording in limb.recordings:
        without = recording.measured.copy()
        without[:, TORQUE, drop] = np.nan
        recordings.append(replace(recording, measured=without))
    return replace(limb, recordings=tuple(recordings)), notes
