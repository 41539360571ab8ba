"""What reaches the drives, foretold: a command path depends on commands alone, not on the motion.

A path asked tick by tick costs several times what the motion does. Asked beforehand, the time
between samples falls into spans in which no target changes, and these a limb takes at full speed.
"""

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def arrivals(ticks, target, path, dt):
    """Spans of constant targets: their ticks (M,), targets (M, J), samples (M,), and ends (n,).

    `ticks` (n,) are the drive periods from each sample to the next and `target` (n, J) what is
    told then; `path` (J, 3) as in `backends.command`, of which nothing is lost. Sample k ends with
    the span `ends[k]`.
    """
    told, late = np.repeat(np.arange(len(ticks)), ticks), path[:, 0] / dt
    spans = np.zeros(len(told) + len(ticks), dtype=np.int64)
    wanted, samples = np.zeros((len(spans), len(path))), np.zeros_like(spans)
    last, ends, tick, span = target[0].copy(), np.zeros_like(ticks), 0, -1
    for k in range(len(ticks)):
        span += 1
        samples[span] = k
        for _ in range(ticks[k]):
            changes = False
            for j in range(len(path)):
                whole = int(late[j])
                share = late[j] - whole
                new = target[told[max(tick - whole, 0)], j]
                if share > 0.0:
                    old = target[told[max(tick - whole - 1, 0)], j]
                    new = (1.0 - share) * new + share * old
                if path[j, 1] > 0.0 and tick > 0:
                    most = dt / path[j, 1]
                    new = last[j] + min(max(new - last[j], -most), most)
                changes |= new != last[j]
                last[j] = new
            if changes and spans[span] > 0:
                span += 1
                samples[span] = k
            wanted[span] = last
            spans[span] += 1
            tick += 1
        ends[k] = span
    return spans[: span + 1], wanted[: span + 1], samples[: span + 1], ends
