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
def _gain(k, run, last, change, block, template, unit, residual, weight, memory, spare):
    """How much less surprising residuals are where targets change from k on, for `run` samples.

    By `change` (K,). `spare` gets the shift of residuals up to block `last`; also, how many it has.
    """
    window, channels = unit.shape[2], unit.shape[3]
    first = block[k]
    length = min(last - first, len(residual) - first, len(spare))
    spare[:length] = 0.0
    for i in range(k, k + run):
        at = block[i] - first
        for j in range(len(change)):
            if change[j] != 0.0:
                for w in range(min(window, length - at)):
                    for c in range(channels):
                        spare[at + w, c] += change[j] * unit[template[i], j, w, c]
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
    lost, held, left = first.copy(), command.copy(), residual.copy()
    for k in range(1, len(command)):
        for g in range(len(groups)):
            if lost[k, g]:
                held[k] = np.where(groups[g], held[k - 1], held[k])
    worth = np.zeros(lost.shape)
    spare = np.zeros((8 * unit.shape[2], unit.shape[3]))
    for _ in range(PASSES):
        turned = 0
        for e in range(len(begins) - 1):
            for n in range((begins[e] + 1) * len(groups), begins[e + 1] * len(groups)):
                k, g = n // len(groups), n % len(groups)
                brings = np.where(groups[g], command[k] - held[k - 1], 0.0)
                worth[k, g] = 0.0
                if np.abs(brings).max() <= SAME:
                    continue
                run = 1  # samples that hold what is held at k: those lost after it do as well
                while k + run < begins[e + 1] and lost[k + run, g]:
                    run += 1
                change = brings if lost[k, g] else -brings
                last = block[min(k + run, begins[e + 1] - 1)] + unit.shape[2]
                given = block, template, unit, left, weight, memory, spare
                gain, length = _gain(k, run, last, change, *given)
                worth[k, g] = gain
                if gain + (price if lost[k, g] else -price) > 0.0:
                    lost[k, g] = not lost[k, g]
                    worth[k, g] = -gain
                    turned += 1
                    left[block[k] : block[k] + length] -= spare[:length]
                    held[k : k + run] += change
        if turned == 0:
            break
    return lost, worth, left
