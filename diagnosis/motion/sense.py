"""What sensors show of a motion, compiled: late, scaled and offset readings, as block means."""

import numba
import numpy as np

from diagnosis.motion.columns import ACROSS, BIAS, LATE, ONCE, SCALE


@numba.njit(cache=True, error_model="numpy")
def sense(ticks, at, edges, at_motor, ahead, p, dt, shown):
    """Write means of what K joints show over blocks of samples into `shown` (B, 3, K).

    `ticks` (n + 1, 3, K): joint, motor and torque at the start and after every tick; `at` (T,): how
    many ticks every sample is after, broken; `edges` (B + 1,): first samples of the blocks;
    `at_motor` (K,): the side of the gear with the position sensor; `ahead`: ticks after its sample
    that a torque is read.
    """
    last = len(ticks) - 1
    for b in range(len(edges) - 1):
        count = edges[b + 1] - edges[b]
        for j in range(ticks.shape[2]):
            side = 1 if at_motor[j] else 0
            angle = motor = torque = once = 0.0
            for k in range(edges[b], edges[b + 1]):
                now = min(int(np.round(at[k])), last)
                motor += ticks[now, 1, j]
                torque += ticks[min(now + ahead, last), 2, j]
                if p[j, LATE] > 0.0:
                    then = min(max(at[k] - p[j, LATE] / dt, 0.0), float(last))
                    low = min(int(then), last - 1)
                    share = then - low
                    seen = ticks[low, side, j] * (1.0 - share) + ticks[low + 1, side, j] * share
                else:
                    seen = ticks[now, side, j]
                angle += seen
                if p[j, ONCE] != 0.0 or p[j, ACROSS] != 0.0:
                    once += p[j, ONCE] * np.cos(seen) + p[j, ACROSS] * np.sin(seen)
            shown[b, 0, j] = (1.0 + p[j, SCALE]) * angle / count + p[j, BIAS] + once / count
            shown[b, 1, j], shown[b, 2, j] = motor / count, torque / count
