"""A part of a long log that says nearly as much as the whole: what a search or a fit is quick on.

Pieces begin where all joints rest, for a replay begins at rest, and are taken by how much motion a
second of them adds, most for joints that have moved least so far.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from backends.state import Array
from diagnosis.motion.recordings import LEAST_SAMPLES, Recording, stood_s

SEARCHED_S, FITTED_S = 120.0, 1200.0
"""Joint-seconds that a search is made on, and that all is fitted to."""
LEAST = 1 / 6
"""An excerpt has at least this share of its joint-seconds as seconds; no piece is longer."""
PIECE_S = 4.0
"""Pieces last at least so long."""
REST_S, STILL_RAD = 0.3, 4e-3
"""A joint rests whose target stood still for so long, and whose reading kept within this [rad]."""
FIRST = 0.1
"""Of a joint's whole motion: so much is taken to be known before any piece of it is."""


def excerpt(recordings: Sequence[Recording], enough_s: float) -> tuple[Recording, ...]:
    """The recordings, or pieces of them where they are longer than `enough_s` joint-seconds."""
    joints = recordings[0].command.shape[1]
    budget_s = max(1.0 / joints, LEAST) * enough_s
    if sum(float(r.time_s[-1]) for r in recordings) <= 1.5 * budget_s:
        return tuple(recordings)
    longest_s = LEAST * enough_s
    pieces = [piece for recording in recordings for piece in _pieces(recording, longest_s)]
    moved = np.array([np.abs(np.diff(p.asked, axis=0)).sum(axis=0) for p in pieces])
    moved /= np.maximum(moved.sum(axis=0), 1e-12)
    lasts_s = np.array([max(float(p.time_s[-1]), 1e-3) for p in pieces])
    taken: list[int] = []
    seen = np.full(moved.shape[1], FIRST)
    while len(taken) < len(pieces) and lasts_s[taken].sum() < budget_s:
        gain = (moved / seen).sum(axis=1) / lasts_s
        gain[taken] = -1.0
        best = int(np.argmax(gain))
        taken.append(best)
        seen = seen + moved[best]
    return tuple(pieces[k] for k in sorted(taken))


def _pieces(recording: Recording, longest_s: float) -> Iterator[Recording]:
    """The recording cut at rests."""
    starts = [0]
    for k in np.flatnonzero(_rests(recording)):
        if recording.time_s[k] - recording.time_s[starts[-1]] >= PIECE_S:
            starts.append(int(k))
    for begin, end in zip(starts, [*starts[1:], len(recording.time_s)], strict=True):
        end = min(end, int(np.searchsorted(recording.time_s, recording.time_s[begin] + longest_s)))
        if end - begin >= LEAST_SAMPLES:
            before = max(begin - max(3, (end - begin) // 200), 0)
            read = recording.measured[before : begin + 1, 0]
            start = recording.start if begin == 0 else np.nanmean(read, axis=0)
            yield replace(recording.part(begin, end), start=start)


def _rests(recording: Recording) -> Array:
    """Where all joints have rested, (T,)."""
    window = int(np.searchsorted(recording.time_s, REST_S)) + 1
    position, travel = recording.measured[:, 0], np.ptp(recording.measured[:, 0], axis=0)
    moves = np.ptp(recording.command, axis=0) > 0.0
    still = np.minimum(STILL_RAD, np.where(moves, 0.02 * travel, np.inf))
    asked = np.concatenate([recording.asked, recording.push], axis=1)
    steady = stood_s(np.arange(len(asked)), asked) >= window
    size, known = window + 1, np.isfinite(position)
    trailing = {"size": size, "axis": 0, "origin": window // 2}
    top = maximum_filter1d(np.where(known, position, np.inf), **trailing)
    bottom = minimum_filter1d(np.where(known, position, -np.inf), **trailing)
    return steady & np.all(top - bottom <= still, axis=1)
