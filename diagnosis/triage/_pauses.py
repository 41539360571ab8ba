"""When a joint did not follow its commands for a while, as a drive that is off does not."""

from collections.abc import Iterator

import numpy as np

from backends.state import Array
from diagnosis.triage._tracks import Track

OFF, NEAR = 0.3, 0.03
"""A joint does not follow while it is off the nominal world by so much of its travel; it begins
and ends where it is off by the second."""
LEAST_S, LEAST_SAMPLES, MOST, COUNT = 0.3, 20, 0.5, 3
"""It lasts so long, all together no longer than this share of an episode, and is so rare: what
comes again and again is physics."""
ALIKE_S = 0.25
"""Episodes are alike whose pauses begin and end as near [s]."""


def pauses(track: Track) -> Iterator[str]:
    """What to say of each time in which a joint did not follow."""
    if track.travel == 0.0:
        return
    found = [
        _of_episode(track, t, p - s)
        for t, p, s in zip(track.time_s, track.position, track.shown, strict=True)
    ]
    first = next((times for times in found if times), [])
    if len(found) > 1 and all(_alike(times, first) for times in found):
        for begin, end in np.mean(found, axis=0):
            yield f"{track.name} did not follow from {begin:.1f} to {end:.1f} s of every episode"
        return
    for number, times in enumerate(found):
        for begin, end in times:
            yield f"{track.name} did not follow from {begin:.1f} to {end:.1f} s of episode {number}"


def _of_episode(track: Track, time_s: Array, error: Array) -> list[tuple[float, float]]:
    off = np.abs(error) / track.travel
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


def _alike(times: list[tuple[float, float]], first: list[tuple[float, float]]) -> bool:
    if len(times) != len(first) or not times:
        return False
    return bool(np.abs(np.array(times) - np.array(first)).max() < ALIKE_S)
