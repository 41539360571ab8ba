"""What to know of a log that is no fault: pauses of a joint, and stamps that were made up."""

from collections.abc import Iterator

import numpy as np

from backends.state import Array
from diagnosis.motion.limb import BLOCK_S
from diagnosis.motion.recordings import noise_of, stood_s
from diagnosis.triage._tracks import Track

OFF, NEAR = 0.3, 0.03
"""A joint does not follow while it is off the nominal world by so much of its travel; it begins
and ends where it is off by the second."""
LEAST_S, LEAST_SAMPLES, MOST, COUNT = 0.3, 20, 0.5, 3
"""It lasts so long, all together no longer than this share of an episode, and is so rare: what
comes again and again is physics."""
ALIKE_S = 0.25
"""Episodes are alike whose pauses begin and end as near [s]."""
REGULAR = 1e-4
"""Steps of time are equal to this share."""
REST_S, LEAST = 0.3, 20
"""Targets that stood still for so long are at rest; so many samples are needed there."""
JUMP = 0.1
"""What follows a step of the target by so much of its travel is not judged."""
MORE, LATE = 4.0, 0.1
"""Scatter in motion over that at rest, and in time over a period, from which stamps are made up."""


def pauses(track: Track) -> Iterator[str]:
    """When a joint did not follow its commands for a while, as a drive that is off does not."""
    if track.travel == 0.0:
        return
    pairs = zip(track.time_s, track.missed, strict=True)
    found = [_of_episode(t, np.abs(missed) / track.travel) for t, missed in pairs]
    first = np.array(next((times for times in found if times), []))
    said = {f"episode {number}": times for number, times in enumerate(found)}
    several = len(found) > 1 and len(first) and {np.shape(one) for one in found} == {first.shape}
    if several and np.abs(np.array(found) - first).max() < ALIKE_S:
        said = {"every episode": np.mean(found, axis=0).tolist()}
    for where, times in said.items():
        for begin, end in times:
            yield f"{track.name} did not follow from {begin:.1f} to {end:.1f} s of {where}"


def _of_episode(time_s: Array, off: Array) -> list[tuple[float, float]]:
    """When pauses begin and end [s], of a joint that is off by so much of its travel (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], off > NEAR, [0]]).astype(int)))
    found = [
        (float(time_s[begin]), float(time_s[end - 1]))
        for begin, end in edges.reshape(-1, 2)
        if off[begin:end].max() > OFF
        and time_s[end - 1] - time_s[begin] >= LEAST_S
        and end - begin >= LEAST_SAMPLES
    ]
    lasts_s = sum(end - begin for begin, end in found)
    rare = len(found) <= COUNT and lasts_s <= MOST * float(time_s[-1])
    return found if rare else []


def made_up(track: Track) -> Iterator[str]:
    """Time stamps that are more regular than the rows were: made from a row number, say.

    Then readings scatter where a joint moves, as much as it moves in the time that a stamp is off,
    and not where it rests.
    """
    steps = np.concatenate([np.diff(t) for t in track.time_s])
    if track.dt_s < BLOCK_S or np.ptp(steps) > REGULAR * track.dt_s:
        return
    resting, moving, late = list[Array](), list[Array](), list[Array]()
    signals = zip(track.time_s, track.command, track.missed, track.shown, strict=True)
    for time_s, command, missed, shown in signals:
        third = np.abs(np.diff(missed, n=3))
        rests = stood_s(time_s, command) > REST_S
        speed = np.abs(np.gradient(shown, time_s))[3:]
        smooth = stood_s(time_s, command, JUMP * track.travel)[3:] > REST_S
        fast = smooth & (speed > max(float(np.quantile(speed, 0.5)), 1e-9))
        resting.append(third[rests[3:] & rests[:-3]])
        moving.append(third[fast])
        late.append(third[fast] / speed[fast])
    if min(sum(map(len, resting)), sum(map(len, moving))) < LEAST:
        return
    rest, motion, late_s = (
        float(noise_of(np.concatenate(some))) for some in (resting, moving, late)
    )
    if not (motion < MORE * rest or late_s < LATE * track.dt_s):
        yield (
            f"{track.name} scatters in motion as if stamps were off by {1e3 * late_s:.0f} ms, and "
            "not at rest: stamps are too regular; were they made from a row number?"
        )
