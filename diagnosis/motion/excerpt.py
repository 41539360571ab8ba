"""A part of a long log that says nearly as much as the whole: what a search is quick on.

Pieces begin where all joints rest, for a replay begins at rest, and are taken by how much motion a
second of them adds, most for joints that have moved least so far.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from backends.state import Array
from diagnosis.motion.recordings import LEAST_SAMPLES, Recording

ENOUGH_S, LEAST_S = 120.0, 20.0
"""Joint-seconds that a search is made on, and the least time of it."""
PIECE_S, LONGEST_S = 4.0, 20.0
"""Pieces last so long, and never longer."""
REST_S, STILL_RAD = 0.3, 4e-3
"""A joint rests whose target stood still for so long, and whose reading kept within this [rad]."""
FIRST = 0.1
"""Of a joint's whole motion: so much is taken to be known before any piece of it is."""


def excerpt(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """The recordings, or pieces of them where they are longer than a search needs."""
    joints = recordings[0].command.shape[1]
    budget_s = max(ENOUGH_S / joints, LEAST_S)
    if sum(float(r.time_s[-1]) for r in recordings) <= 1.5 * budget_s:
        return tuple(recordings)
    pieces = [piece for recording in recordings for piece in _pieces(recording)]
    moved = np.array([np.abs(np.diff(p.command, axis=0)).sum(axis=0) for p in pieces])
    moved /= np.maximum(moved.sum(axis=0), 1e-12)
    lasts_s = np.array([max(float(p.time_s[-1]), 1e-3) for p in pieces])
    taken: list[int] = []
    seen = np.full(joints, FIRST)
    while len(taken) < len(pieces) and lasts_s[taken].sum() < budget_s:
        gain = (moved / seen).sum(axis=1) / lasts_s
        gain[taken] = -1.0
        best = int(np.argmax(gain))
        taken.append(best)
        seen = seen + moved[best]
    return tuple(pieces[k] for k in sorted(taken))


def _pieces(recording: Recording) -> Iterator[Recording]:
    """The recording cut at rests."""
    starts = [0]
    for k in np.flatnonzero(_rests(recording)):
        if recording.time_s[k] - recording.time_s[starts[-1]] >= PIECE_S:
            starts.append(int(k))
    for begin, end in zip(starts, [*starts[1:], len(recording.time_s)], strict=True):
        end = min(end, int(np.searchsorted(recording.time_s, recording.time_s[begin] + LONGEST_S)))
        if end - begin >= LEAST_SAMPLES:
            yield _piece(recording, begin, end)


def _piece(recording: Recording, begin: int, end: int) -> Recording:
    before = max(begin - max(3, (end - begin) // 200), 0)
    read = recording.measured[before : begin + 1, 0]
    return replace(
        recording,
        time_s=recording.time_s[begin:end] - recording.time_s[begin],
        command=recording.command[begin:end],
        push=recording.push[begin:end],
        speed=None if recording.speed is None else recording.speed[begin:end],
        torque=None if recording.torque is None else recording.torque[begin:end],
        measured=recording.measured[begin:end],
        start=recording.start if begin == 0 else np.nanmean(read, axis=0),
    )


def _rests(recording: Recording) -> Array:
    """Where all joints have rested, (T,)."""
    window = int(np.searchsorted(recording.time_s, REST_S)) + 1
    position, travel = recording.measured[:, 0], np.ptp(recording.measured[:, 0], axis=0)
    still = np.minimum(STILL_RAD, 0.02 * travel)
    found = np.zeros(len(recording.time_s), dtype=bool)
    for k in range(window, len(found)):
        part = slice(k - window, k + 1)
        quiet = not np.any(np.ptp(recording.command[part], axis=0))
        quiet = quiet and not np.any(recording.push[part] != recording.push[k])
        found[k] = quiet and bool(np.all(np.ptp(position[part], axis=0) <= still))
    return found
