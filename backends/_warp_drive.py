"""The drive law as a Warp kernel: `backends.drive`, tick by tick, where the worlds are.

Warp compiles no text that numba compiles (it wants typed literals), so the law stands here once
more; a test holds the two to 1e-6. Rotors are kept in double precision: a gear's spring acts on
small differences of angles.
"""

import math

import warp as wp

from backends.drive import BRISTLE_RAD, COGGING_RAD, HEAT_S, MOST_FADED, STRIBECK_RAD_S

_TURN, _TOOTH = wp.constant(wp.float64(2.0 * math.pi)), wp.constant(wp.float64(COGGING_RAD))
_WARM, _MOST = wp.constant(wp.float64(HEAT_S)), wp.constant(wp.float64(MOST_FADED))
_BRISTLE = wp.constant(wp.float64(BRISTLE_RAD))
_V_S = wp.constant(wp.float64(STRIBECK_RAD_S))
_NONE, _HALF = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(0.5))


@wp.func
def _shrink(speed: wp.float64, loss: wp.float64) -> wp.float64:
    """Reduce `speed` by `loss` towards zero, but not beyond zero; NaN stays NaN."""
    if speed > loss:
        return speed - loss
    if speed < -loss:
        return speed + loss
    if speed == speed:
        return _NONE
    return speed


@wp.kernel(enable_backward=False)
def drive_tick(
    target: wp.array2d[wp.float64],
    qpos: wp.array2d[float],
    qvel: wp.array2d[float],
    joint_q: wp.array[int],
    joint_v: wp.array[int],
    numbers: wp.array3d[wp.float64],
    dt: wp.float64,
    motor: wp.array2d[wp.float64],
    motor_speed: wp.array2d[wp.float64],
    pd_nm: wp.array2d[wp.float64],
    tick: wp.array[int],
    gear_nm: wp.array3d[wp.float64],
    applied: wp.array2d[float],
):
    """Step every drive (N, J) by one period and apply its torque to its joint.

    It is written into `gear_nm` (N, T, J), where the world's `tick` (N,) says.
    """
    n, j = wp.tid()
    p = numbers[n, j]  # as in `backends.drive.drive_table`
    kp, kd, limit, inertia = p[0], p[1], p[2], p[3]
    coulomb, viscous, k, c = p[4], p[5], p[6], p[7]
    play, lock, stiction, load, dead = p[8], p[9], p[10], p[11], p[12]
    way, fall = p[13], p[14]
    joint, joint_speed = wp.float64(qpos[n, joint_q[j]]), wp.float64(qvel[n, joint_v[j]])
    speed = motor_speed[n, j]
    rub = _NONE
    if stiction > _NONE:
        rub = stiction * wp.exp(-wp.abs(speed) / _V_S)
    cog = _NONE
    if p[15] != _NONE:
        period = wp.where(p[16] > _NONE, p[16], _TOOTH)
        cog = p[15] * wp.sin(_TURN * motor[n, j] / period + p[17])
    if p[20] > _NONE:  # heat
        share = _NONE
        if limit > _NONE:
            share = pd_nm[n, j] / limit
        heat = numbers[n, j, 28]
        heat += dt / wp.where(p[21] > _NONE, p[21], _WARM) * (share * share - heat)
        numbers[n, j, 28] = heat
        cog -= wp.min(p[20] * heat, _MOST) * pd_nm[n, j]
    if p[22] > _NONE:  # bristles
        slid = dt * speed / wp.where(p[23] > _NONE, p[23], _BRISTLE)
        bend = (numbers[n, j, 29] + slid) / (wp.float64(1.0) + wp.abs(slid))
        numbers[n, j, 29] = bend
        cog -= p[22] * bend
    gap = motor[n, j] - joint
    press = gap + play
    if gap > _NONE:
        press = gap - play
    gear = k * press + c * (speed - joint_speed)
    touches = gap > play or gap < -play or play == _NONE
    if (play > _NONE and gear * press < _NONE) or not touches:
        gear = _NONE
    pd = kp * _shrink(target[n, j] - motor[n, j], dead) - kd * speed
    lost = fall * speed
    high = limit - wp.min(wp.max(lost, _NONE), limit)
    low = wp.min(wp.max(-lost, _NONE), limit) - limit
    if pd > high:  # unlike with min and max, NaN stays NaN
        pd = high
    if pd < low:
        pd = low
    cog -= p[27] * pd
    friction = coulomb + load * wp.abs(gear) + rub
    speed += dt / inertia * (pd + cog - gear - viscous * speed)
    friction += wp.max(wp.where(speed > _NONE, way, -way), _NONE)
    speed = _shrink(speed, dt / inertia * friction)
    if speed * pd <= _NONE and speed * gear < _NONE:
        speed = _shrink(speed, dt / inertia * lock)
    past = joint + _HALF * dt * joint_speed - p[18]
    if p[19] * past > _NONE:
        gear -= wp.abs(p[19]) * past
    gear -= p[24] * (joint - p[25])
    motor[n, j] += dt * speed
    motor_speed[n, j] = speed
    pd_nm[n, j] = pd
    gear_nm[n, tick[n], j] = gear
    applied[n, joint_v[j]] = float(gear)


@wp.kernel(enable_backward=False)
def carry_tick(
    tick: wp.array[int],
    ticks: wp.array[int],
    carry_n: wp.array2d[float],
    stick_v: int,
    applied: wp.array2d[float],
):
    """Carry the sticks of the worlds that are weightless for so many more `ticks` (N,).

    It counts each world's `tick` (N,) of the policy period.
    """
    n = wp.tid()
    lifted = ticks[n] > 0
    for i in range(3):
        applied[n, stick_v + i] = wp.where(lifted, carry_n[n, i], 0.0)
    tick[n] += 1
    ticks[n] = wp.max(ticks[n] - 1, 0)
