"""Time stamps that are more regular than the rows were: made from a row number, say.

Then readings scatter where a joint moves, as much as it moves in the time that a stamp is off, and
not where it rests.
"""

import numpy as np

from backends.state import Array
from diagnosis.motion.limb import BLOCK_S
from diagnosis.motion.recordings import noise_of, stood_s
from diagnosis.triage._tracks import Track

REGULAR = 1e-4
"""Steps of time are equal to this share."""
REST_S, LEAST = 0.3, 20
"""Targets that stood still for so long are at rest; so many samples are needed there."""
JUMP = 0.1
"""What follows a step of the target by so much of its travel is not judged."""
MORE, LATE = 4.0, 0.1
"""Scatter in motion over that at rest, and in time over a period, from which stamps are made up."""


def made_up(track: Track) -> str | None:
    """What to say of stamps that are too regular; None where nothing shows it."""
    steps = np.concatenate([np.diff(t) for t in track.time_s])
    if track.dt_s < BLOCK_S or np.ptp(steps) > REGULAR * track.dt_s:
        return None
    resting, moving, late = list[Array](), list[Array](), list[Array]()
    pairs = zip(track.time_s, track.command, track.position, track.shown, strict=True)
    for time_s, command, position, shown in pairs:
        third = np.abs(np.diff(position - shown, n=3))
        rests = stood_s(time_s, command) > REST_S
        speed = np.abs(np.gradient(shown, time_s))[3:]
        smooth = stood_s(time_s, command, JUMP * track.travel)[3:] > REST_S
        fast = smooth & (speed > max(float(np.quantile(speed, 0.5)), 1e-9))
        resting.append(third[rests[3:] & rests[:-3]])
        moving.append(third[fast])
        late.append(third[fast] / speed[fast])
    if min(sum(map(len, resting)), sum(map(len, moving))) < LEAST:
        return None
    rest, motion, late_s = (
        float(noise_of(np.concatenate(some))) for some in (resting, moving, late)
    )
    if motion < MORE * rest or late_s < LATE * track.dt_s:
        return None
    return (
        f"{track.name} scatters in motion as if stamps were off by {1e3 * late_s:.0f} ms, and not "
        "at rest: stamps are too regular; were they made from a row number?"
    )
