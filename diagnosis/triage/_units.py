"""Command and position both in another unit: in which the nominal world moves as logged.

Where nothing but stiffness and inertia acts, a motion looks the same in every unit. Weight, limits
of torque and links that turn far tell units apart, and so does the joint's range.
"""

import numpy as np

from diagnosis.triage._signals import OPTIONS
from diagnosis.triage._tracks import BETTER, Fault, Track

BEYOND, WITHIN = 3.0, 1.5
"""Commands beyond the first multiple of a joint's range are in another unit if that brings them
within the second."""
FINE, SAME = 0.05, 0.2
"""Share of the motion that is left where no unit can be wrong, and up to which another is right."""
ASIDE = np.array([0.5, 0.6, 0.7, 0.77, 0.84, 1.19, 1.3, 1.43, 1.67, 2.0])
"""Multiples of a unit that are tried beside it."""
RIVAL = 2.0
"""A unit must leave less than a weight that is carried, or another limit, by this factor."""

LIMIT, WEIGHT = "its limit of torque is another", "its drive carries the weight"
HELD = "friction holds it beside its targets"


def in_unit(track: Track, unit: str, evidence: str) -> Fault:
    """Commands and positions that are in another unit."""
    option = f", or read the table with --unit {OPTIONS[unit]}" if unit in OPTIONS else ""
    return track.fault("unit", evidence, f"convert command and position to {track.si}{option}")


def scaled(track: Track, size: float, evidence: str) -> Fault:
    """Commands and positions in a unit without a name, of which so many make one of SI's."""
    gear = f"motor-side, {size:.2g} to 1" if size > 1.0 else f"geared, 1 to {1.0 / size:.2g}"
    return track.fault(
        "unit",
        f"both are in a unit of which about {size:.2g} make one {track.si}: {gear}, or of a "
        f"calibration: {evidence}",
        f"convert them to {track.si}",
    )


def both(track: Track) -> Fault | None:
    """Both sides in another unit, by the joint's range or by how it moves."""
    tried, reach, room, si = _possible(track), track.reach, track.room, track.si
    if tried and reach >= BEYOND * room:
        where = f"commands reach {reach:.3g} {si}, the joint only {room:.3g} {si}"
        best = _best(track, tried)[0]
        return in_unit(track, best, f"{where}: commands and positions are in {best}")
    said = _moves_as_logged(track)
    if said is None or _rivals(track, tried[said[0]]):
        return None
    near = {size: _left(track.varied(size)) for size in tried[said[0]] * ASIDE}
    other = min(near, key=near.__getitem__)
    if near[other] * BETTER < _left(track.varied(tried[said[0]])):
        why = "then the nominal world moves as logged, and in no named unit"
        return scaled(track, float(other), why)
    return in_unit(track, said[0], "both are in {}: {}".format(*said))


def perhaps(track: Track) -> str | None:
    """What to say where another unit would explain a motion, and so would another limit alone."""
    said = _moves_as_logged(track)
    if said is None or _rivals(track, _possible(track)[said[0]]) != [LIMIT]:
        return None
    return f"commands and positions of {track.name} may be in {said[0]}: {said[1]}; or {LIMIT}"


def _possible(track: Track) -> dict[str, float]:
    """Units in which the commands are within the joint's range.

    Which counts of an encoder they are, no motion says.
    """
    most = WITHIN * track.room
    return {n: size for n, size in track.units.items() if track.reach / size <= most}


def _best(track: Track, tried: dict[str, float]) -> tuple[str, float]:
    """The unit that leaves least, or the first where that is hardly more; and what it leaves."""
    found = {name: _left(track.varied(size)) for name, size in tried.items()}
    first, best = next(iter(found)), min(found, key=found.__getitem__)
    best = best if found[best] * BETTER < found[first] else first
    return best, found[best]


def _moves_as_logged(track: Track) -> tuple[str, str] | None:
    """The unit in which the nominal world moves as logged, and what shows it."""
    tried, left = _possible(track), _left(track) if track.travel else 0.0
    if not tried or left < FINE:
        return None
    best, then = _best(track, tried)
    if then > SAME or then * BETTER > left:
        return None
    return best, (
        f"then the nominal world moves as logged (it leaves {then:.2g} of the motion, and as they "
        f"are {left:.2g})"
    )


def _rivals(track: Track, per_si: float) -> list[str]:
    """What else leaves as little: another limit of the torque, a carried weight, friction."""
    found = {
        LIMIT: _left(track.varied(limited=per_si)),
        WEIGHT: _left(track.weightless()),
        HELD: _left(track, rubs=True),
    }
    most = RIVAL * _left(track.varied(per_si))
    return [text for text, left in found.items() if left < most]


def _left(track: Track, rubs: bool = False) -> float:
    """Share of the motion that is left with the nominal world's, of any size and a little late.

    `rubs`: and beside it to either side, as dry friction and a load hold a joint.
    """
    shown, read = np.concatenate(track.shown), np.concatenate(track.position)
    if not np.isfinite(shown).all():
        return np.inf
    pairs = zip(track.time_s, track.shown, strict=True)
    speed = np.concatenate([np.gradient(s, t) for t, s in pairs])
    beside = [np.sign(speed), np.ones_like(speed)] if rubs else []
    columns = np.stack([shown, speed, *beside], axis=1)
    return track.share(read - columns @ np.linalg.lstsq(columns, read)[0])
