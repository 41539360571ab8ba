"""Decoding of lost packets: which targets never arrived, given what the mechanism then did.

Each packet that brings a new target either arrived or was lost, and a lost one leaves the last
target standing. Worlds that differ in the last few decisions are simulated side by side; where two
of them agree on these, the one that fits the log better goes on (the Viterbi algorithm with a state
per survivor: Raheli, Polydoros and Tzou, IEEE Trans. Communications 43, 1995).
"""

import numba
import numpy as np

from diagnosis.replay.limb import rest, run

MEMORY = 3
"""Decisions that are kept open."""
TAIL = 4.0
"""Degrees of freedom of Student's t: the tails of an innovation."""
SAME = 1e-9
"""A target that moved less brings nothing new [rad]."""


@numba.njit(cache=True)
def _surprise(shown, logged, last, has_last, weight, memory):
    """Cost [nats] of one sample's innovations; `last` (C, J) becomes its residuals.

    NaN where a channel was not logged: it costs nothing.
    """
    cost = 0.0
    for c in range(shown.shape[0]):
        for j in range(shown.shape[1]):
            residual = logged[c, j] - shown[c, j]
            if not np.isfinite(residual):
                residual = np.nan if np.isnan(logged[c, j]) else 1e6
            if has_last and np.isfinite(residual) and np.isfinite(last[c, j]):
                e = (residual - memory[c, j] * last[c, j]) * weight[c, j]
                cost += 0.5 * (TAIL + 1.0) * np.log1p(e * e / TAIL)
            last[c, j] = residual
    return cost


@numba.njit(cache=True)
def decode(
    ticks,
    target,
    load,
    start,
    logged,
    lossy,
    price,
    weight,
    memory,
    limb,
    rings,
):
    """Lost packets (T,) bool, and what is then shown (T, C, J).

    `logged` is (T, C, J) with channels position, motor and torque; `lossy` (J,) are the joints
    whose packets may be lost; each loss costs `price`. `weight` and `memory` (C, J) are one over
    the scale of an innovation and how much of a residual lives on to the next sample. `limb` and
    `rings` are those of `replay.limb`
    for 2^(MEMORY + 1) worlds.
    """
    samples, joints = target.shape
    half = 1 << MEMORY
    worlds = 2 * half
    state, age = rest(start, limb), np.zeros(worlds, dtype=np.int64)
    held, last = np.zeros((1, worlds, joints)), np.zeros((worlds, 3, joints))
    shown = np.zeros((1, worlds, 4, joints))
    cost = np.full(worlds, np.inf)
    cost[0] = 0.0
    alive = np.zeros(worlds, dtype=np.bool_)
    parent = np.zeros((samples, half), dtype=np.int8)
    picture = np.zeros((samples, half, 3, joints))
    lost_now = np.zeros((samples, half), dtype=np.bool_)
    winner = np.zeros(worlds, dtype=np.int64)
    alive[0] = True
    gaps = np.diff(ticks)
    run(gaps[:1] - gaps[:1], held, load[:1], alive, limb, rings, state, age, shown)
    for k in range(samples):
        # Survivors are worlds 0 .. half - 1 here.
        for w in range(half):
            if alive[w]:
                seen = shown[0, w, :3]
                cost[w] += _surprise(seen, logged[k], last[w], k > 0, weight, memory)
                picture[k, w] = seen
        if k + 1 == samples:
            break
        # Packet k: it arrives in world w, and is lost in world half + w.
        for w in range(half):
            alive[half + w] = False
            if not alive[w]:
                continue
            news = False
            for j in range(joints):
                if lossy[j] and abs(target[k, j] - held[0, w, j]) > SAME:
                    news = True
            if k > 0 and news:
                v = half + w
                alive[v] = True
                state[v], last[v], age[v], held[0, v] = state[w], last[w], age[w], held[0, w]
                rings[0][v], rings[1][v] = rings[0][w], rings[1][w]
                cost[v] = cost[w] + price
                for j in range(joints):
                    if not lossy[j]:
                        held[0, v, j] = target[k, j]
            held[0, w] = target[k]
        run(gaps[k : k + 1], held, load[k : k + 1], alive, limb, rings, state, age, shown)
        # Of worlds with the same last decisions the cheapest so far survives.
        winner[:half] = -1
        for w in range(worlds):
            if alive[w]:
                slot = ((2 * (w % half)) | (w // half)) % half
                if winner[slot] < 0 or cost[w] < cost[winner[slot]]:
                    winner[slot] = w
        if winner[0] != 0 or (winner[1:half] >= 0).any():
            _survive(winner, half, state, held[0], shown[0], last, cost, age, rings)
        for s in range(half):
            alive[s] = winner[s] >= 0
            parent[k + 1, s] = winner[s] % half if alive[s] else -1
            lost_now[k, s] = alive[s] and winner[s] >= half
    best = 0
    for w in range(half):
        if alive[w] and (not alive[best] or cost[w] < cost[best]):
            best = w
    lost = np.zeros(samples, dtype=np.bool_)
    out = np.zeros((samples, 3, joints))
    for k in range(samples - 1, -1, -1):
        out[k] = picture[k, best]
        if k > 0:
            lost[k - 1] = lost_now[k - 1, best]
            best = parent[k, best]
    return lost, out


@numba.njit(cache=True)
def _survive(winner, half, state, held, shown, last, cost, age, rings):
    """Move the winners to the worlds 0 .. half - 1."""
    old = (state.copy(), held.copy(), shown.copy(), last.copy(), cost.copy(), age.copy())
    old_rings = (rings[0].copy(), rings[1].copy())
    for s in range(half):
        w = winner[s]
        if w < 0:
            cost[s] = np.inf
            continue
        state[s], held[s], shown[s] = old[0][w], old[1][w], old[2][w]
        last[s], cost[s], age[s] = old[3][w], old[4][w], old[5][w]
        rings[0][s], rings[1][s] = old_rings[0][w], old_rings[1][w]
