"""What is wrong with a log itself, before any cause is sought: sensors, samples, torques.

What cannot be used is left out with a note; a log that then says nothing is refused.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.state import Array
from diagnosis.logs.log import LogError
from diagnosis.motion.columns import LIMIT
from diagnosis.motion.integrate import FROM, THEN, UNTIL
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
"""Torques are of the wrong sign below this correlation with what the drive law asks for, with the
error of the position and with what the motion takes, and are noise where they hardly have any."""
STOP_NEAR, STOP_S, STOP_SHARE = 0.01, 0.3, 0.5
"""A joint stands at the end of its range within this share of it, while its target is beyond and it
does not follow; until so long after [s]. Not where that is more than this share of the log."""
UNSIGNED, CLEAR = 0.1, 0.7
"""Torques that are never negative are magnitudes where the drive pulls back by this share of all,
both as the model asks for and as the joint misses its targets; not beyond this correlation."""
TORQUE = CHANNELS.index("torque")


class StillError(LogError):
    """Nothing is asked of a limb: a log says nothing of it."""


def checked(limb: Limb) -> tuple[Limb, tuple[str, ...]]:
    """The limb's log without what cannot be, and notes of it; raises LogError."""
    _require_motion(limb)
    notes = []
    wrong = [_wrong(recording, limb) for recording in limb.recordings]
    if count := sum(int(one.sum()) for one in wrong):
        notes.append(f"{count} absurd samples of {', '.join(limb.joints)} are left out")
        limb = _without(limb, wrong)
    limb, stopped = _without_stops(limb)
    limb, more = _with_plausible_torques(limb)
    return limb, (*notes, *stopped, *more)


def _without(limb: Limb, masks: Sequence[Array]) -> Limb:
    """The limb without what is masked of its readings (T, 3, K), by episode."""
    pairs = zip(limb.recordings, masks, strict=True)
    cleaned = (replace(r, measured=np.where(mask, np.nan, r.measured)) for r, mask in pairs)
    return replace(limb, recordings=tuple(cleaned))


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


def _wrong(recording: Recording, limb: Limb) -> Array:
    """Which of the readings (T, 3, K) are absurd.

    A step's torque peaks in a single sample: absurd are those beyond `BEYOND_LIMIT`.
    """
    wrong = np.apply_along_axis(absurd, 0, recording.measured)
    most = BEYOND_LIMIT * limb.nominal[:, LIMIT]
    wrong[:, TORQUE] &= np.abs(recording.measured[:, TORQUE]) > most
    return wrong


def _without_stops(limb: Limb) -> tuple[Limb, list[str]]:
    """The limb without readings at the ends of its joints' ranges, where replays go on; and notes.

    Where its model ends a joint no fault shows: no replay has those stops.
    """
    masks, notes = [np.zeros(r.measured.shape, dtype=bool) for r in limb.recordings], []
    for j, body in enumerate(limb.spec.hand.driven):
        ends, is_open = body.joint.range_rad, bool(limb.open[j])
        stopped = [_at_ends(recording, j, ends, is_open) for recording in limb.recordings]
        share = float(np.concatenate(stopped).mean())
        if 0.0 < share < STOP_SHARE:
            notes.append(
                f"{limb.joints[j]} stands at the end of its range for {100 * share:.2g} % of the "
                "log, with targets beyond it: that is not judged"
            )
            for mask, rows in zip(masks, stopped, strict=True):
                mask[rows, :, j] = True
    return (_without(limb, masks) if notes else limb), notes


def _at_ends(recording: Recording, joint: int, ends: tuple[float, float], is_open: bool) -> Array:
    """Rows (T,) at which a joint stands at an end of its range, and some time after them."""
    command, position = recording.command[:, joint], recording.measured[:, 0, joint]
    near = STOP_NEAR * (ends[1] - ends[0])
    rows = np.zeros(len(command), dtype=bool)
    for side, end in zip((-1.0, 1.0), ends, strict=True):
        past, asked = side * (position - end), side * (command - end)
        most = 0.0 if is_open else asked.max() / 2
        if np.nanmax(past) < max(near, most):
            rows |= (is_open | (asked > 0.0)) & (past > -near)
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


def _with_plausible_torques(limb: Limb) -> tuple[Limb, Sequence[str]]:
    """The limb, as its torques were read, without those that cannot be its drives'.

    Whether what drives carry of the weight is among them tells their size. Our own simulators' are
    of the period until their samples; else changes tell it, for most faults change slowly.
    """
    measured = limb.measured[:, TORQUE]
    if not np.isfinite(measured).any():
        return limb, ()
    if any(body.carried for body in limb.spec.hand.driven):
        ways = [limb.alike(reads_carried=reads) for reads in (False, True)]
        limb = min(ways, key=lambda one: _off(one, measured))
    most = np.nanmax(np.abs(measured), axis=0, initial=1e-12)
    reads = (UNTIL,) if limb.exact else (UNTIL, THEN, FROM)
    ways = [limb.alike(torque_read=read) for read in reads]
    shows = [one.simulate(limb.nominal)[:, TORQUE] for one in ways]
    far = [np.nansum(np.abs(np.diff((s - measured) / most, axis=0))) for s in shows]
    limb, shown = ways[int(np.argmin(far))], shows[int(np.argmin(far))]
    command = np.concatenate([r.command for r in limb.recordings])
    missed = limb.means(lambda recording: recording.command - recording.measured[:, 0])
    bearing = limb.spec.with_driven(replace(b, carried=0.0) for b in limb.spec.hand.driven)
    models = (limb.spec,) if bearing == limb.spec else (limb.spec, bearing)
    by_error = np.where(limb.open, np.nan, missed)
    expected = [shown, by_error, *(limb.needed(spec) for spec in models)]
    dropped, notes = np.zeros((len(CHANNELS), len(limb.joints)), dtype=bool), []
    for j, name in enumerate(limb.joints):
        both = np.isfinite(measured[:, j]) & np.isfinite(shown[:, j])
        if both.sum() < 10 or np.std(shown[both, j]) == 0.0:
            continue
        read, what = measured[both, j], ""
        asked = [one[both, j] for one in expected if np.isfinite(one[both, j]).all()]
        if np.std(read) > 0.0:
            alike, back = _alike(read, asked), min(map(_backward, (*asked, missed[both, j])))
            unsigned = read.min() >= 0.0 and back > UNSIGNED and alike < CLEAR
            if unsigned and not limb.open[j]:
                what = "without its sign"
            elif alike < UNRELATED:
                what = "of the wrong sign" if alike < OPPOSED else "noise"
        elif np.ptp(command[:, j]) > MOVES_RAD:
            what = "the same throughout"
        if what:
            dropped[TORQUE, j] = True
            notes.append(f"the torque of {name} is {what} and left out")
    return (_without(limb, [dropped] * len(limb.recordings)) if notes else limb), notes


def _off(limb: Limb, torques: Array) -> float:
    """How far a limb's nominal torques are from those that were read (N, K)."""
    return float(np.nansum(np.abs(limb.simulate(limb.nominal)[:, TORQUE] - torques)))


def _alike(torques: Array, expected: Sequence[Array]) -> float:
    """The best correlation of torques (T,) with one of what is expected, each (T,)."""
    return max(float(np.corrcoef(torques, one)[0, 1]) for one in expected if np.std(one) > 0.0)


def _backward(torques: Array) -> float:
    """The negative share of torques (T,), or of what goes with them."""
    return float(np.nansum(np.maximum(-torques, 0.0)) / max(np.nansum(np.abs(torques)), 1e-12))
