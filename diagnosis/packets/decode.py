"""Which packets were lost: those whose loss explains what a limb did better than it costs to say.

Compiled. A limb's answer to losses is the sum of unit responses (`responses`), so one packet at a
time is turned from arrived to lost, or back, until no turn makes residuals more likely. Errors of a
model are smooth and a lost packet is abrupt: what counts are innovations, with Student's tails.
"""

import numba
import numpy as np

TAIL = 4.0
"""Degrees of freedom of Student's t."""
PASSES = 6
"""Times that all packets are looked at."""
SAME = 1e-9
"""A target that differs less brings nothing new [rad]."""


@numba.njit(cache=True, error_model="numpy")
def surprise(e):
    """Minus the logarithm of the likelihood of an innovation, but for a constant [nats]."""
    return 0.5 * (TAIL + 1.0) * np.log1p(e * e / TAIL)


@numba.njit(cache=True, error_model="numpy")
def _turn(k, end, command, lost, held, lossy, change):
    """How held targets change when packet k is turned; the number of samples that change."""
    now = held[k].copy()
    kept = held[k - 1].copy()
    count = 0
    for t in range(k, end):
        gone = lost[t] if t > k else not lost[k]
        for j in range(command.shape[1]):
            now[j] = (kept[j] if gone else command[t, j]) if lossy[j] else held[t, j]
            change[count, j] = now[j] - held[t, j]
            kept[j] = now[j]
        count += 1
        if t > k and not gone:
            break
    return count


@numba.njit(cache=True, error_model="numpy")
def _gain(k, count, change, block, template, unit, residual, weight, memory, spare):
    """How much less surprising residuals are with the change; `spare` gets the shift."""
    window, channels = unit.shape[2], unit.shape[3]
    first = block[k]
    last = min(block[k + count - 1] + window, len(residual))
    length = min(last - first, len(spare))
    spare[:length] = 0.0
    for i in range(count):
        at = block[k + i] - first
        for j in range(change.shape[1]):
            if change[i, j] != 0.0:
                for w in range(min(window, length - at)):
                    for c in range(channels):
                        spare[at + w, c] += change[i, j] * unit[template[k + i], j, w, c]
    gain = 0.0
    for b in range(length):
        for c in range(channels):
            if weight[c] > 0.0:
                before = residual[first + b - 1, c] if first + b > 0 else 0.0
                old = residual[first + b, c] - memory[c] * before
                before -= spare[b - 1, c] if b > 0 else 0.0
                new = residual[first + b, c] - spare[b, c] - memory[c] * before
                gain += surprise(old * weight[c]) - surprise(new * weight[c])
    return gain, length


@numba.njit(cache=True, error_model="numpy")
def decode(command, begins, groups, first, price, block, template, unit, residual, weight, memory):
    """Lost packets (T, G), what each decision was worth [nats], and the residuals left (N, M).

    `groups` (G, K): joints whose targets are in one packet. `first` (T, G): packets whose loss is
    in `residual` already; `price`: nats that each loss costs. A packet that brings nothing new is
    worth nothing.
    """
    samples, joints = command.shape
    lost, held, left = first.copy(), command.copy(), residual.copy()
    for k in range(1, samples):
        for g in range(len(groups)):
            for j in range(joints):
                if lost[k, g] and groups[g, j]:
                    held[k, j] = held[k - 1, j]
    worth = np.zeros(lost.shape)
    change = np.zeros((samples, joints))
    spare = np.zeros((8 * unit.shape[2], unit.shape[3]))
    for _ in range(PASSES):
        turned = 0
        for e in range(len(begins) - 1):
            for n in range((begins[e] + 1) * len(groups), begins[e + 1] * len(groups)):
                k, g = n // len(groups), n % len(groups)
                lossy, brings = groups[g], False
                for j in range(joints):
                    brings |= lossy[j] and abs(command[k, j] - held[k - 1, j]) > SAME
                worth[k, g] = 0.0
                if not brings:
                    continue
                count = _turn(k, begins[e + 1], command, lost[:, g], held, lossy, change)
                given = block, template, unit, left, weight, memory, spare
                gain, length = _gain(k, count, change, *given)
                net = gain + (price if lost[k, g] else -price)
                worth[k, g] = gain
                if net > 0.0:
                    lost[k, g] = not lost[k, g]
                    worth[k, g] = -gain
                    turned += 1
                    for b in range(length):
                        for c in range(left.shape[1]):
                            left[block[k] + b, c] -= spare[b, c]
                    for i in range(count):
                        for j in range(joints):
                            held[k + i, j] += change[i, j]
        if turned == 0:
            break
    return lost, worth, left
