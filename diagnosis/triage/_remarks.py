"""What to know of a log that is no fault: pauses of a joint, and stamps that were made up."""

from collections.abc import Iterator

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import quantisation_step
from diagnosis.motion.limb import BLOCK_S
from diagnosis.motion.recordings import noise_of, stood_s
from diagnosis.triage._tracks import Track

OFF, NEAR = 0.3, 0.03
"""A joint does not follow while it is off the nominal world by so much of its travel; that ends
where it is off by less than the second, or than is usual."""
LEAST_S, LEAST_SAMPLES, MOST, COUNT = 0.3, 20, 0.5, 3
"""It lasts so long, all together no longer than this share of an episode, and is so rare: what
comes again and again is physics."""
USUAL = 2.0
"""An error is more than usual beyond so many medians."""
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
    every = dict[int, list[tuple[float, float]]]()
    for number in dict.fromkeys(one.episode for one in track.limb.recordings):
        time_s, off = _of_episode(track, number)
        times = _spans(time_s, off / track.travel)
        seen_s = float(np.diff(time_s)[np.diff(time_s) < LEAST_S].sum())
        paused_s = sum(end - begin for begin, end in times)
        every[number] = times if len(times) <= COUNT and paused_s <= MOST * seen_s else []
    said = {f"episode {number}": times for number, times in every.items()}
    first, *rest = map(np.array, every.values())
    near = (len(one) == len(first) and np.abs(one - first).max() < ALIKE_S for one in rest)
    if rest and len(first) and all(near):
        said = {"every episode": np.mean([first, *rest], axis=0).tolist()}
    for where, times in said.items():
        for begin, end in times:
            yield f"{track.name} did not follow from {begin:.1f} to {end:.1f} s of {where}"


def _of_episode(track: Track, number: int) -> tuple[Array, Array]:
    """When [s], and by how much, a joint is off in what there is of an episode (T,), (T,)."""
    pairs = zip(track.limb.recordings, track.missed, strict=True)
    parts = [(one.began_s + one.time_s, np.abs(m)) for one, m in pairs if one.episode == number]
    time_s, off = (np.concatenate(some) for some in zip(*parts, strict=True))
    off[1:][np.diff(time_s) >= LEAST_S] = 0.0  # nothing goes on over what is left out
    return time_s, off


def _spans(time_s: Array, off: Array) -> list[tuple[float, float]]:
    """When pauses begin and end [s], of a joint that is off by so much of its travel (T,).

    A joint that stands is passed by its target now and then. One that is off was so before that
    is more than usual: a pause begins where the error does.
    """
    usual = USUAL * float(np.median(off))
    odd = off > max(NEAR, usual)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], odd, [0]]).astype(int)))
    spans = list[tuple[int, int]]()
    for begin, end in edges.reshape(-1, 2).tolist():
        if off[begin:end].max() > OFF:
            passed = bool(spans) and time_s[begin] - time_s[spans[-1][1] - 1] < LEAST_S
            spans.append((spans.pop()[0] if passed else begin, end))
    calm = np.flatnonzero(off <= usual)
    after = np.append(-1, calm)[np.searchsorted(calm, np.arange(len(off)))] + 1
    return [
        (float(time_s[after[begin]]), float(time_s[end - 1]))
        for begin, end in spans
        if time_s[end - 1] - time_s[begin] >= LEAST_S and end - begin >= LEAST_SAMPLES
    ]


def made_up(track: Track) -> Iterator[str]:
    """Time stamps that are more regular than the rows were: made from a row number, say.

    Then readings scatter where a joint moves, as much as it moves in the time that a stamp is off,
    and not where it rests.
    """
    steps = np.concatenate([np.diff(t) for t in track.time_s])
    if track.limb.period_s < BLOCK_S or np.ptp(steps) > REGULAR * track.limb.period_s:
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
    step = quantisation_step(np.concatenate(track.position))
    rest = float(np.hypot(rest, step / np.sqrt(12.0)))  # rounding is no noise where a joint rests
    if not (motion < MORE * rest or late_s < LATE * track.limb.period_s):
        yield (
            f"{track.name} scatters in motion as if stamps were off by {1e3 * late_s:.0f} ms, and "
            "not at rest: stamps are too regular; were they made from a row number?"
        )
