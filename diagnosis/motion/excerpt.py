"""A part of a long log that says nearly as much as the whole: what a search or a fit is quick on.

Pieces are taken by what a second of them adds: motion, and error that is unlike that of the rest of
the log, most of joints that have shown least so far. They begin at rests, or where none comes for
long, in motion. The last ends where enough is taken.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from backends.spec import Spec
from backends.state import Array
from diagnosis.logs.log import Log
from diagnosis.motion.limb import block_means
from diagnosis.motion.recordings import (
    LEAST_SAMPLES,
    Recording,
    episodes_of,
    recording,
    recordings,
    stood_s,
)

SEARCHED_S, FITTED_S = 80.0, 600.0
"""Joint-seconds that a search is made on, and that all is fitted to."""
LEAST = 1 / 6
"""An excerpt has at least this share of its joint-seconds as seconds; no piece is longer."""
PIECE_S = 4.0
"""Pieces last at least so long."""
REST_S, STILL_RAD = 0.3, 4e-3
"""A joint rests whose target stood still for so long, and whose reading kept within this [rad]."""
FIRST = 0.1
"""Of what all of a joint's pieces show: so much is taken to be known before any of them is."""
COARSE_S = 0.02
"""Pieces are chosen by means over so long."""
CHUNK = 50_000
"""A log is looked through by so many rows."""


def excerpt(recordings: Sequence[Recording], enough_s: float) -> tuple[Recording, ...]:
    """The recordings, or pieces of them where they are longer than `enough_s` joint-seconds."""
    lasts_s = sum(one.time_s[-1] for one in recordings)
    if not _is_long(lasts_s, recordings[0].command.shape[1], enough_s):
        return tuple(recordings)
    chosen = _chosen([_Coarse.of([one]) for one in recordings], enough_s)
    return tuple(_piece(recordings[k], begin, end, rests) for k, begin, end, rests in chosen)


def excerpted(log: Log, limb: Spec, enough_s: float) -> tuple[tuple[Recording, ...], float]:
    """The same of a limb's episodes in a log, and how long these are [s].

    Without all of a long log in memory. Raises LogError where there are none.
    """
    every = episodes_of(log, limb)
    lasts_s = sum(float(np.ptp(log.episode(one.episode)["t_s"])) for one in every)
    if not _is_long(lasts_s, len(limb.hand.joint_names), enough_s):
        return recordings(log, limb), lasts_s
    coarse = []
    for one in every:
        chunks = (slice(k, k + CHUNK) for k in range(0, len(log.episode(one.episode)), CHUNK))
        coarse.append(_Coarse.of(recording(log, limb, one, chunk) for chunk in chunks))
    found = []
    for number, begin, end, rests in _chosen(coarse, enough_s):
        before = max(2 * begin - end, 0)
        near = recording(log, limb, every[number], slice(before, end))
        found.append(_piece(near, begin - before, end - before, rests))
    return tuple(found), lasts_s


def _is_long(lasts_s: float, joints: int, enough_s: float) -> bool:
    return lasts_s > 1.5 * _budget_s(joints, enough_s)


def _budget_s(joints: int, enough_s: float) -> float:
    return max(1.0 / joints, LEAST) * enough_s


@dataclass(frozen=True, kw_only=True, eq=False)
class _Coarse:
    """An episode of K joints in B blocks."""

    time_s: Array
    row: Array
    """First rows of the blocks, and the end, shape (B + 1,)."""
    asked: Array
    """All that is asked and pushed at their beginnings, shape (B, A)."""
    command: Array
    position: Array
    """Means of the readings, shape (B, K)."""

    @classmethod
    def of(cls, parts: Iterable[Recording]) -> "_Coarse":
        """An episode that comes in parts."""
        found, end = list[tuple[Array, ...]](), 0
        for one in parts:
            size = max(1, round(COARSE_S / max(float(np.median(np.diff(one.time_s))), 1e-6)))
            starts = np.arange(0, len(one.time_s), size)
            asked = np.concatenate([one.asked, one.push], axis=1)[starts]
            position = block_means(one.measured[:, 0], np.append(starts, len(one.time_s)))
            time_s = one.began_s + one.time_s[starts]
            found.append((time_s, end + starts, asked, one.command[starts], position))
            end += len(one.time_s)
        time_s, row, asked, command, position = map(np.concatenate, zip(*found, strict=True))
        time_s, row = time_s - time_s[0], np.append(row, end)
        return cls(time_s=time_s, row=row, asked=asked, command=command, position=position)

    @cached_property
    def rests(self) -> Array:
        """Where all joints have rested, (B,)."""
        window = int(np.searchsorted(self.time_s, REST_S)) + 1
        position = self.position
        travel = np.nanmax(position, axis=0) - np.nanmin(position, axis=0)
        moves = np.ptp(self.command, axis=0) > 0.0
        still = np.minimum(STILL_RAD, np.where(moves, 0.02 * travel, np.inf))
        steady = stood_s(np.arange(len(self.asked)), self.asked) >= window
        size, known = window + 1, np.isfinite(position)
        trailing = {"size": size, "axis": 0, "origin": window // 2}
        top = maximum_filter1d(np.where(known, position, np.inf), **trailing)
        bottom = minimum_filter1d(np.where(known, position, -np.inf), **trailing)
        return np.asarray(steady & np.all(top - bottom <= still, axis=1))

    def pieces(self, longest_s: float) -> Iterator[tuple[int, int]]:
        """From which block to before which its pieces go: cut at rests, or where too long."""
        starts = [0]
        for k in [*np.flatnonzero(self.rests), len(self.time_s)]:
            last_s = self.time_s[min(k, len(self.time_s) - 1)]
            while last_s - self.time_s[starts[-1]] > longest_s + PIECE_S:
                at_s = self.time_s[starts[-1]] + longest_s
                starts.append(max(int(np.searchsorted(self.time_s, at_s)), starts[-1] + 1))
            if k < len(self.time_s) and last_s - self.time_s[starts[-1]] >= PIECE_S:
                starts.append(int(k))
        for begin, end in zip(starts, [*starts[1:], len(self.time_s)], strict=True):
            if self.row[end] - self.row[begin] >= LEAST_SAMPLES:
                yield begin, end

    @property
    def error(self) -> Array:
        """How far the joints are from what is asked, (B, K)."""
        return np.nan_to_num(self.command - self.position)

    @property
    def laws(self) -> Array:
        """What errors follow from where nothing changes: pose, speed and its sign, (B, 3 + 2K)."""
        q = np.nan_to_num(self.position)
        v = np.gradient(q, np.maximum(self.time_s, 0.0) + 1e-9 * np.arange(len(q)), axis=0)
        sign = np.tanh(v / np.maximum(np.quantile(np.abs(v), 0.5, axis=0), 1e-9))
        return np.concatenate([np.ones((len(q), 1)), v, sign, np.sin(q), np.cos(q)], axis=1)


def _chosen(every: Sequence[_Coarse], enough_s: float) -> Iterator[tuple[int, int, int, bool]]:
    """The pieces that show most: episode, first row, the row after, and whether it begins at rest.

    Shown are targets that move, and errors beside `laws` of the whole log, squared.
    """
    pieces = [(k, *ends) for k, one in enumerate(every) for ends in one.pieces(LEAST * enough_s)]
    pairs = ((one.laws, one.error) for one in every)
    normal = ((laws.T @ laws, laws.T @ error) for laws, error in pairs)
    by = np.linalg.lstsq(*(sum(x) for x in zip(*normal, strict=True)))[0]
    odd = [(one.error - one.laws @ by) ** 2 for one in every]
    moves = [np.abs(np.diff(every[k].asked[a:b], axis=0)).sum(axis=0) for k, a, b in pieces]
    strange = [odd[k][a:b].sum(axis=0) for k, a, b in pieces]
    shows = np.concatenate([moves, strange], axis=1)
    shows /= np.maximum(shows.sum(axis=0), 1e-12)
    lasts_s = np.array([every[k].time_s[b - 1] - every[k].time_s[a] for k, a, b in pieces])
    lasts_s, budget_s = np.maximum(lasts_s, 1e-3), _budget_s(every[0].command.shape[1], enough_s)
    taken: list[int] = []
    seen = np.full(shows.shape[1], FIRST)
    while len(taken) < len(pieces) and lasts_s[taken].sum() < budget_s:
        gain = (shows / seen).sum(axis=1) / lasts_s
        gain[taken] = -1.0
        best = int(np.argmax(gain))
        taken.append(best)
        seen = seen + shows[best]
    over_s = max(lasts_s[taken].sum() - budget_s, 0.0)
    for n in sorted(taken):
        k, a, b = pieces[n]
        if n == taken[-1]:
            ends_s = every[k].time_s[a] + max(lasts_s[n] - over_s, PIECE_S)
            b = min(int(np.searchsorted(every[k].time_s, ends_s)) + 1, b)
        yield k, int(every[k].row[a]), int(every[k].row[b]), bool(every[k].rests[a])


def _piece(whole: Recording, begin: int, end: int, rests: bool) -> Recording:
    """Rows of a recording; they begin where it rests, or as it moves there."""
    part = whole.part(begin, end)
    if begin == 0:
        return part
    if rests:
        reach = max(3, (end - begin) // 200)
        read = whole.measured[max(begin - reach, 0) : begin + 1, 0]
        return replace(part, start=np.nanmean(read, axis=0))
    reach = max(2, int(np.searchsorted(part.time_s, COARSE_S)))
    near = slice(max(begin - reach, 0), begin + reach + 1)
    away_s, read = whole.time_s[near] - whole.time_s[begin], whole.measured[near, 0]
    rate, start = np.polyfit(away_s, np.nan_to_num(read), 1)
    return replace(part, start=start, rate=rate)
