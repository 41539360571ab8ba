"""When each jump of the commands acts, where a row does not say so: by the motion that follows it.

What a log shows changes by so much with the moment of a jump that single moments are found: by one
linear step for all of them and the numbers of a fit, each within a row. Commands that change little
by little have no such moments of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.sparse import csc_array

from backends.state import Array
from diagnosis.evidence.evidence import root_weights
from diagnosis.search.fit import Fit, Fitter
from diagnosis.search.problem import Problem

NEAR, JUMP = 3, 4.0
"""A command jumps where it changes by so many times more than in each of so many rows before and
after."""
LASTS_S = 0.5
"""The motion that follows a jump, at most [s]: jumps so far apart do not mix."""
OVER = 0.25
"""Share of a row over which slopes are taken."""


@dataclass(frozen=True, kw_only=True)
class Jump:
    """A command that jumps."""

    recording: int
    row: int
    early_s: float
    """How much earlier than its limb's other commands it acts [s]."""
    known: float
    """What the log says of that [1/s^2]."""


def jumps(command: Array) -> Array:
    """The rows (J,) in which some command of (T, K) jumps."""
    change = np.abs(np.diff(command, axis=0, prepend=command[:1]))
    padded = np.pad(change, ((NEAR, NEAR), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEAR + 1, axis=0)
    around = np.delete(windows, NEAR, axis=2).max(axis=2)
    return np.flatnonzero((change > JUMP * around).any(axis=1))


def moved_jumps(fitter: Fitter, fit: Fit, early_s: Sequence[Array]) -> list[Jump]:
    """When jumps act, by what a fit leaves.

    `early_s`: how much earlier than the others each command of the recordings acts now [s].
    """
    limb, base = fitter.evidence.limb, fitter.shown(fit.u)
    row_s = limb.period_s
    weights = root_weights(fitter.evidence, fit.residual)
    found, columns = list[tuple[int, int]](), list[tuple[Array, Array]]()
    sent = [r.time_s if r.sent_s is None else r.sent_s for r in limb.recordings]
    apart = [_apart(r.time_s, jumps(r.command)) for r in limb.recordings]
    for some in zip_longest(*apart, fillvalue=()):
        moved = [one.copy() for one in sent]
        for one, rows in zip(moved, some, strict=True):
            one[list(rows)] -= OVER * row_s
        change = fitter.of(limb.with_signals(sent_s=moved)).shown(fit.u) - base
        slope = np.nan_to_num(change / (OVER * row_s))
        for number, rows in enumerate(some):
            for row in rows:
                at = _following(fitter, number, row)
                columns.append((at, (slope * weights)[at]))
                found.append((number, row))
    if not found:
        return []
    slopes, problem = _sparse(columns, len(base)), Problem.of(fitter.parameters, fit.freed)
    sd, now = row_s / np.sqrt(12.0), np.array([early_s[number][row] for number, row in found])
    own = (slopes.T @ slopes).toarray()
    pull = slopes.T @ (fit.residual * weights) - now / sd**2
    others, more = problem.normal(fit.slopes, weights, fit.residual, fit.u)
    shared = slopes.T @ problem.jacobian(fit.slopes, weights)
    by = np.linalg.solve(others, np.column_stack([shared.T, more]))
    left = own + np.eye(len(found)) / sd**2 - shared @ by[:, :-1]
    step = np.linalg.solve(left, pull - shared @ by[:, -1])
    there = np.clip(now + step, -row_s / 2, row_s / 2)
    each = zip(found, there, np.diag(own), strict=True)
    return [Jump(recording=n, row=k, early_s=float(x), known=float(h)) for (n, k), x, h in each]


def _apart(time_s: Array, rows: Array) -> list[list[int]]:
    """Rows in groups whose motions do not mix."""
    groups = list[list[int]]()
    for row in map(int, rows):
        free = (one for one in groups if time_s[row] - time_s[one[-1]] >= LASTS_S)
        if (group := next(free, None)) is None:
            groups.append(group := [])
        group.append(row)
    return groups


def _following(fitter: Fitter, recording: int, row: int) -> Array:
    """Readings, by number, that a jump moves."""
    limb, logged = fitter.evidence.limb, fitter.evidence.logged
    began = sum(len(edges) - 1 for edges in limb.edges[:recording])
    at_s = limb.recordings[recording].time_s[row]
    ends_s = at_s - 2.0 * limb.period_s, at_s + LASTS_S
    begin, end = began + np.searchsorted(limb.time_s[recording], ends_s)
    block = np.broadcast_to(np.arange(logged.shape[-1]), logged.shape)[logged]
    return np.flatnonzero((block >= begin) & (block < end))


def _sparse(columns: Sequence[tuple[Array, Array]], rows: int) -> csc_array:
    ends = np.cumsum([0, *(len(at) for at, _ in columns)])
    at, values = (np.concatenate(one) for one in zip(*columns, strict=True))
    return csc_array((values, at, ends), shape=(rows, len(columns)))
