"""Precompute what reaches the drives: it depends on the commands alone, not on the motion.

Computing the path tick by tick costs several times as much as the motion. So it is computed before
the replay: the time is split into spans with constant targets, which a limb is stepped through at
full speed. Late sensors need additional spans, because they show the motion at earlier times.
"""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def arrivals(ticks, target, path, late, dt):
    """Spans of constant targets: their ticks (M,), samples (M,), targets (M, J), and ends.

    `ticks` (n,) are the drive periods up to each sample and `target` (n, J) the commands there;
    `path` (J, P) as in `backends.command`, of which nothing is lost or rounded. A span ends
    wherever sensors that are `late` (J,) [s] look back to; after so many ticks the span `ends` of
    that has ended.
    """
    row_of, slow = np.repeat(np.arange(len(ticks)), ticks), path[:, 0] / dt
    looks = _looks(ticks, late / dt)
    spans = np.zeros(len(row_of) + len(ticks), dtype=np.int64)
    wanted, samples = np.zeros((len(spans), len(path))), np.zeros_like(spans)
    last, ends, tick, span = target[0].copy(), np.zeros(len(row_of) + 1, dtype=np.int64), 0, -1
    for k in range(len(ticks)):
        span += 1
        samples[span], wanted[span] = k, last
        for _ in range(ticks[k]):
            new_span = looks[tick]
            for j in range(len(path)):
                whole = int(slow[j])
                share = slow[j] - whole
                new = target[row_of[max(tick - whole, 0)], j]
                if share > 0.0:
                    old = target[row_of[max(tick - whole - 1, 0)], j]
                    new = (1.0 - share) * new + share * old
                if path[j, 1] > 0.0 and tick > 0:
                    most = dt / path[j, 1]
                    new = last[j] + min(max(new - last[j], -most), most)
                new_span |= new != last[j]
                last[j] = new
            if new_span and spans[span] > 0:
                span += 1
                samples[span] = k
            wanted[span] = last
            spans[span] += 1
            tick += 1
            ends[tick] = span
    return spans[: span + 1], samples[: span + 1], wanted[: span + 1], ends


@numba.njit(cache=True, error_model="numpy")
def _looks(ticks, late):
    """After which ticks a sensor that is `late` (J,) ticks looks at the motion, bool."""
    looks, tick = np.zeros(ticks.sum() + 1, dtype=np.bool_), 0
    for k in range(len(ticks)):
        tick += ticks[k]
        for j in range(len(late)):
            if late[j] > 0.0:
                whole = int(late[j])
                looks[max(tick - whole, 0)] = looks[max(tick - whole - 1, 0)] = True
    return looks


@numba.njit(cache=True, error_model="numpy")
def looked(ticks, late, ends, shown, out):
    """Write what late sensors show (n, J) of a motion: `shown` (M, J) at the end of each span."""
    tick = 0
    for k in range(len(ticks)):
        tick += ticks[k]
        for j in range(len(late)):
            whole = int(late[j])
            share = late[j] - whole
            out[k, j] = shown[ends[max(tick - whole, 0)], j]
            if share > 0.0:
                before = shown[ends[max(tick - whole - 1, 0)], j]
                out[k, j] = (1.0 - share) * out[k, j] + share * before
