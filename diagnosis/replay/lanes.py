"""Replay limbs of one or two joints in closed form, several at a time by SIMD instructions.

A tick depends on the previous one, but not on the ticks of other worlds and episodes. Four of them
take little longer than one. Lanes share nothing, and each gives exactly what it gives alone.
"""

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_features

from backends.drive import COLUMNS, MEMORY, cogged, remembered, rubbing, turn_motor
from diagnosis.replay.expansion import (
    SMALL_RAD,
    accelerate_one,
    accelerate_two,
    turned_a_little,
    wave,
)

CHANNELS = ("position", "motor", "torque", "velocity")
"""What is shown: readings of a joint's sensor, its motor's angle, its PD torque, and its speed."""
LANES = 8
"""Largest number of lanes."""
REGISTER = 8 if get_host_cpu_features().get("avx512f") else 4
"""Number of doubles in this processor's registers; a smaller rest is computed one by one."""
_ANGLE, _SPEED, _MOTOR, _MOTOR_SPEED, _TORQUE, _COS, _SIN, _TARGET, _LOAD, _RUB, _COG, _DRIVE = (
    LANES * row for row in range(12)
)
"""Where a joint's rows begin, each a number per lane; the last are the numbers of its drive."""
_INERTIA, _STICTION, _COGGING, _PERIOD, _PHASE = (
    _DRIVE + LANES * COLUMNS.index(name)
    for name in (
        *("rotor_inertia_kgm2", "stiction_nm"),
        *("cogging_nm", "cogging_period_rad", "cogging_phase_rad"),
    )
)
_MEMORIES = COLUMNS.index("thermal_fade"), COLUMNS.index("presliding_nm")
_FADE, _SLIDING = (_DRIVE + LANES * column for column in _MEMORIES)
_LIMIT, _HEAT = _DRIVE + LANES * COLUMNS.index("torque_limit_nm"), _DRIVE + LANES * len(COLUMNS)
_JOINT = _HEAT + LANES * len(MEMORY)
_CLOSED, _SIZE = 2 * _JOINT, 2 * _JOINT + 33 * LANES
"""Behind two joints are the coefficients of `expand`."""
_FOREVER = 2**62
"""Remaining ticks of a lane that has no episode."""


@numba.njit(cache=True, error_model="numpy")
def together(begin, spans, start, drive, closed, at_motor, dt, out):
    """Take a limb from rest through E episodes; where one ends, its lane takes up the next.

    Of episode e are the spans `begin[e]` to `begin[e + 1]`, one or more. `spans` are of all: ticks
    (S,), whether it is a sample's first (S,), targets and loads (S, J), constant in a span. At the
    `start` are the angles (E, J); `drive` (J, 26) and `closed` (33,) are the numbers of the drives
    and of `expand`. Into `out` (S, 4, J) goes what is shown after each span: `CHANNELS`, by
    sensors without bias or scale.
    """
    ticks, first, target, load = spans
    x = np.zeros(_SIZE)  # all in one array: several might overlap, for all the compiler knows
    span, end, left = np.zeros((3, LANES), np.int64)
    episode, idle, joints = 0, 0, len(at_motor)
    remembers = np.any(drive[:, _MEMORIES[0]]) or np.any(drive[:, _MEMORIES[1]])
    lanes = min(-(-len(start) // REGISTER) * REGISTER, LANES)
    while True:
        for w in range(lanes):
            while left[w] == 0:
                if span[w] < end[w]:
                    _show(x, w, at_motor, out, span[w])
                    span[w] += 1
                if span[w] == end[w] and episode == len(start):
                    _rest(x, w)
                    left[w], idle = _FOREVER, idle + 1
                    continue
                if span[w] == end[w]:
                    _begin(x, w, start[episode], drive, closed)
                    span[w], end[w], episode = begin[episode], begin[episode + 1], episode + 1
                k = span[w]
                left[w] = ticks[k]
                for j in range(joints):
                    at = j * _JOINT + w
                    x[at + _TARGET], x[at + _LOAD] = target[k, j], load[k, j]
                    if first[k]:
                        x[at + _COS], x[at + _SIN] = wave(x[at + _ANGLE])
        if idle == lanes:
            return
        now = left[0]
        for w in range(lanes):
            now = min(now, left[w])
        if joints == 1:
            _one(now, x, lanes, dt, remembers)
        else:
            _two(now, x, lanes, dt, remembers)
        for w in range(lanes):
            left[w] -= now


@numba.njit(cache=True, error_model="numpy")
def _begin(x, w, start, drive, closed):
    x[w::LANES] = 0.0
    for j in range(len(start)):
        at = j * _JOINT + w
        x[at + _ANGLE] = x[at + _MOTOR] = start[j]
        for k in range(drive.shape[1]):
            x[at + _DRIVE + k * LANES] = drive[j, k]
    for k in range(len(closed)):
        x[_CLOSED + k * LANES + w] = closed[k]


@numba.njit(cache=True, error_model="numpy")
def _rest(x, w):
    """An idle lane: nothing moves, and no number is small enough to slow the processor."""
    x[w::LANES] = 0.0
    x[_INERTIA + w] = x[_JOINT + _INERTIA + w] = 1.0
    x[_CLOSED + w] = x[_CLOSED + 10 * LANES + w] = 1.0


@numba.njit(cache=True, error_model="numpy")
def _show(x, w, at_motor, out, k):
    for j in range(len(at_motor)):
        at = j * _JOINT + w
        out[k, 0, j] = x[at + _MOTOR] if at_motor[j] else x[at + _ANGLE]
        out[k, 1, j], out[k, 2, j], out[k, 3, j] = x[at + _MOTOR], x[at + _TORQUE], x[at + _SPEED]


@numba.njit(cache=True, error_model="numpy")
def _one(ticks, x, lanes, dt, remembers):
    """Take lone joints through some ticks."""
    for _ in range(ticks):
        _rub(x, 0, lanes)
        if remembers:
            _recall(x, 0, lanes, dt)
        for w in range(lanes):
            gear = _drive(x, w, dt)
            own = x[w + _COS], x[w + _SIN]
            _move(x, w, accelerate_one(own, gear + x[w + _LOAD], x, _CLOSED + w, LANES), dt)
        _turn_far(x, 0, lanes, dt)


@numba.njit(cache=True, error_model="numpy")
def _two(ticks, x, lanes, dt, remembers):
    """Take two joints each through some ticks."""
    for _ in range(ticks):
        _rub(x, 0, lanes)
        _rub(x, _JOINT, lanes)
        if remembers:
            _recall(x, 0, lanes, dt)
            _recall(x, _JOINT, lanes, dt)
        for w in range(lanes):
            v = w + _JOINT
            gear, gear2 = _drive(x, w, dt), _drive(x, v, dt)
            waves = (x[w + _COS], x[w + _SIN]), (x[v + _COS], x[v + _SIN])
            torques = gear + x[w + _LOAD], gear2 + x[v + _LOAD]
            moved, moved2 = accelerate_two(
                *waves, x[w + _SPEED], x[v + _SPEED], *torques, x, _CLOSED + w, LANES
            )
            _move(x, w, moved, dt)
            _move(x, v, moved2, dt)
        _turn_far(x, 0, lanes, dt)
        _turn_far(x, _JOINT, lanes, dt)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _rub(x, at, lanes):
    """Stiction and cogging, which need functions that no instruction is."""
    for w in range(lanes):
        if x[at + _STICTION + w] > 0.0:
            x[at + _RUB + w] = rubbing(x[at + _MOTOR_SPEED + w], x[at + _STICTION + w])
        if x[at + _COGGING + w] != 0.0:
            law = x[at + _COGGING + w], x[at + _PERIOD + w], x[at + _PHASE + w]
            x[at + _COG + w] = cogged(x[at + _MOTOR + w], *law)


@numba.njit(cache=True, error_model="numpy")
def _recall(x, at, lanes, dt):
    """Add what motors remember to their cogging: apart, for most remember nothing."""
    for w in range(lanes):
        fade, slides, memory = at + _FADE + w, at + _SLIDING + w, at + _HEAT + w
        own = x[fade], x[fade + LANES], x[slides], x[slides + LANES]
        state = x[memory], x[memory + LANES]
        now = x[at + _MOTOR_SPEED + w], x[at + _TORQUE + w], dt, x[at + _LIMIT + w]
        more, x[memory], x[memory + LANES] = remembered(*now, *own, *state)
        x[at + _COG + w] = more + (x[at + _COG + w] if x[at + _COGGING + w] != 0.0 else 0.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _drive(x, at, dt):
    """Turn a rotor; the torque on its joint."""
    p = at + _DRIVE
    own = (
        *(x[p], x[p + LANES], x[p + 2 * LANES], x[p + 3 * LANES], x[p + 4 * LANES]),
        *(x[p + 5 * LANES], x[p + 6 * LANES], x[p + 7 * LANES], x[p + 8 * LANES]),
        *(
            x[p + 9 * LANES],
            x[p + 10 * LANES],
            x[p + 11 * LANES],
            x[p + 12 * LANES],
            x[p + 13 * LANES],
            x[p + 14 * LANES],
            x[p + 15 * LANES],
            x[p + 16 * LANES],
            x[p + 17 * LANES],
            x[p + 18 * LANES],
            x[p + 19 * LANES],
        ),
    )
    joint, motor = (x[at + _ANGLE], x[at + _SPEED]), (x[at + _MOTOR], x[at + _MOTOR_SPEED])
    given = x[at + _RUB], x[at + _COG], dt
    motor_rad, rate, pd, gear = turn_motor(x[at + _TARGET], *joint, *motor, *given, own)
    x[at + _MOTOR], x[at + _MOTOR_SPEED], x[at + _TORQUE] = motor_rad, rate, pd
    return gear


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _move(x, at, acceleration, dt):
    speed = x[at + _SPEED] + dt * acceleration
    own = turned_a_little((x[at + _COS], x[at + _SIN]), dt * speed)
    x[at + _SPEED], x[at + _COS], x[at + _SIN] = speed, own[0], own[1]
    x[at + _ANGLE] += dt * speed


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _turn_far(x, at, lanes, dt):
    """Where a joint moved far in a tick, its cosine and sine anew."""
    far = False
    for w in range(lanes):
        far |= abs(dt * x[at + _SPEED + w]) > SMALL_RAD
    for w in range(lanes if far else 0):
        if abs(dt * x[at + _SPEED + w]) > SMALL_RAD:
            x[at + _COS + w], x[at + _SIN + w] = wave(x[at + _ANGLE + w])
