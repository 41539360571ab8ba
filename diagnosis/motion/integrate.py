"""A limb of K joints in compiled code, along the motion that was measured.

    (M + D dt) a = tau + push - h - G (q - q_m) - C (v - v_m) - spring (q - rest)

M, h, G = dh/dq and C = dh/dv are taken once at points (q_m, v_m) of the measured motion, so a
replay computes no kinematics and needs no measured accelerations. Or M and h have a closed form
and are exact at every tick, as in an engine. A drive is rigid, with all of
its damping implicit and dry friction solved with the joints (projected Gauss-Seidel, as MuJoCo's
implicitfast; it holds, or yields under load as MuJoCo's does), or it turns a second mass behind a
gear (`backends/drive.py`). Its law is

    tau = lag(clip(kp dead_zone(e) + I + (1 - u) kd s + given) + u kd s)    see `backends/drive.py`
    I' = kp i e + c (kp e + kd s)
    e = target - motor,    s = lead target' - filter(motor')

with the target that its profile makes of the command, and a torque that is given beside it. I
begins where the drive carries the weight at the start. An open loop feeds no position back: e = 0,
and kp is the gain of the given torque. G and C then hold the joint to the measured motion as well.
A loop that is slower than the ticks holds what it has clipped until it acts again.
"""

import numba
import numpy as np

from backends.drive import cogged, remembered, rubbing
from diagnosis.motion import columns as c
from diagnosis.motion.columns import ACROSS, BIAS, LATE, ONCE, SCALE, ZERO
from diagnosis.replay.dynamics import closed_form

SWEEPS = 3
"""Iterations of dry friction over coupled joints."""
YIELD_S = 9.5e-3
"""Time constant by which MuJoCo's dry friction stops a joint: d_max t / 2 of its default solref and
solimp, see "Solver parameters" in its documentation."""
EVEN = 1e-9
"""Ticks that are off by less than such a share of a loop's period are on time."""
FAR_RAD = 1e4
"""A joint beyond this has diverged."""


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _shrink(x, by):
    return x - by if x > by else (x + by if x < -by else 0.0)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _sent(command, k, split, j):
    """The target [rad] that row k sends in a tick, for a share of which the one before is kept."""
    asked = command[k, j]
    return asked if split == 0.0 else asked + split * (command[k - 1, j] - asked)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _between(given, n, after, part, j, what):
    """What is given beside the target, between the rows n and `after`."""
    return given[n, j, what] + part * (given[after, j, what] - given[n, j, what])


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _limited(wanted, last, slowness, dt):
    """The target [rad] of a drive that moves it by a radian in no less than `slowness` [s]."""
    if slowness == 0.0:
        return wanted
    most = dt / slowness
    return last + min(max(wanted - last, -most), most)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _profiled(wanted, last, rate, slowness, most, dt):
    """Target [rad] and its speed [rad/s] where it moves by an acceleration `most` and stops."""
    away, step = abs(wanted - last), most * dt
    speed = np.sqrt(0.25 * step**2 + 2.0 * most * away) - 0.5 * step
    speed = min(speed, 1.0 / slowness) if slowness > 0.0 else speed
    rate += min(max((speed if wanted > last else -speed) - rate, -step), step)
    if abs(rate) <= step and away <= step * dt:
        return wanted, 0.0
    return last + dt * rate, rate


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _pd(error, slip, more, speed, kp, kd, limit, dead_zone, fall):
    """The torque of the PD law and of `more`, and whether it is at its limit."""
    wanted = kp * _shrink(error, dead_zone) + kd * slip + more
    lost = fall * speed
    high, low = limit - min(max(lost, 0.0), limit), min(max(-lost, 0.0), limit) - limit
    pd = min(max(wanted, low), high)
    return pd, pd != wanted


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _acts(t, period, dt):
    """Whether a loop acts at a tick: at the first one in each of its periods."""
    return (
        period <= dt
        or t == 0
        or np.floor(t * dt / period + EVEN) > np.floor((t - 1) * dt / period + EVEN)
    )


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _gear(gap, slip, play, stiffness, teeth):
    """The torque through a gear: teeth only push."""
    press = gap - play if gap > 0.0 else gap + play
    gear = stiffness * press + teeth * slip
    return 0.0 if play > 0.0 and (abs(gap) <= play or gear * press < 0.0) else gear


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _turned(speed, pd, cog, gear, viscous, rub, way, lock, r, damped):
    """A rotor's speed after a tick r = dt / J; friction stops it and never reverses it."""
    speed += r * (pd + cog - gear - viscous * speed) / (1.0 + r * damped)
    speed = _shrink(speed, r * (rub + max(way if speed > 0.0 else -way, 0.0)))
    return _shrink(speed, r * lock) if speed * pd <= 0.0 and speed * gear < 0.0 else speed


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _invert(a):
    """Invert a symmetric positive definite matrix in place, by Gauss and Jordan.

    LAPACK takes ten times as long for so few joints.
    """
    n = len(a)
    for i in range(n):
        pivot = 1.0 / a[i, i]
        a[i, i] = 1.0
        for j in range(n):
            a[i, j] *= pivot
        for k in range(n):
            share = a[k, i]
            if k != i and share != 0.0:
                a[k, i] = 0.0
                for j in range(n):
                    a[k, j] -= share * a[i, j]


@numba.njit(cache=True, error_model="numpy")
def integrate(
    dt, stride, q_m, v_m, model, command, given, push, acts, start, p, ends, soft, implicit, out
):
    """Write joint, motor and PD torque of K joints into `out` (n + 1, 3, K).

    At the start, where two masses have no torque yet, as in an engine, and after every tick.

    Points q_m, v_m (P, K), one every `stride` ticks, with their `Along.changed` model; commands and
    pushes (T, K), and what `acts` at every tick: the row of a command, the share of the tick for
    which the one before it does, and the row of a push, each (n,); `given` (T, K, 2): the target's
    speed, NaN where the drive makes it, and a torque, or (0, K, 2); start (2, K): positions and
    speeds; numbers p (K, len(COLUMNS)), end stops as `backends.drive.stops` has them (K, 2), and
    `Limb.soft` (K,).
    `implicit`: damping and stops at the end of a tick, as MuJoCo's damping. False where the motion
    diverged.

    One function holds the arrays: to hand them on costs more than the tick itself.
    """
    mass, bias, dq, dv, closed = model
    row, split, pushed = acts
    joints, exact = start.shape[1], len(closed) > 0
    q, v, motor, speed = start[0].copy(), start[1].copy(), start[0].copy(), start[1].copy()
    if exact:
        q_m, v_m, bias = np.zeros((3, 1, joints))
        mass, dq, dv = np.zeros((3, 1, joints, joints))
        closed_form(closed, q, v, mass[0], bias[0])
    end, last_tick = len(mass) - 1, len(row) - 1
    target, gear, force = command[0].copy(), np.zeros(joints), np.zeros(joints)
    accel, after, rub, impulse, damped, firm, pressed = np.zeros((7, joints))
    rate, slow, total, lagged, heat, bend, last_pd = np.zeros((7, joints))
    share, quick = dt / (p[:, c.FILTER] + dt), dt / (p[:, c.LAG] + dt)
    yielding, slides_on = p[:, c.SOFT] * soft, 1.0 - dt / np.maximum(p[:, c.SOFT] * YIELD_S, dt)
    for j in range(joints):
        pressed[j] = p[j, c.SPRING] * (q[j] - p[j, c.REST])
        lagged[j] = (bias[0, j] + pressed[j] - push[0, j]) / (1.0 - p[j, c.WEAK])
        if p[j, c.INTEGRAL] > 0.0 or p[j, c.CASCADE] > 0.0:
            total[j] = lagged[j] - (1.0 - p[j, c.OPEN]) * p[j, c.KP] * (command[0, j] - q[j])
    inverse = np.zeros((joints, joints))
    held, at_limit = np.zeros(joints, np.bool_), np.zeros(joints, np.bool_)
    asked_nm, presses = np.zeros(joints), np.any(ends[:, 1]) or np.any(p[:, c.SPRING])
    out[0], out[0, 2] = start[0], 0.0
    for t in range(len(row)):
        i, k, changed = min(t // stride, end), row[t], exact or t % stride == 0
        m = pushed[t]
        if exact:
            closed_form(closed, q, v, mass[0], bias[0])
        for j in range(joints):
            asked, n, then_n, part = _sent(command, k, split[t], j), k, k, 0.0
            if p[j, c.DELAY] != 0.0:
                then = t - p[j, c.DELAY] / dt
                before = int(np.floor(then))
                low, high = min(max(before, 0), last_tick), min(max(before + 1, 0), last_tick)
                n, then_n, part = row[low], row[high], then - before
                asked = _sent(command, then_n, split[high], j) * part
                asked += _sent(command, n, split[low], j) * (1.0 - part)
            last = target[j]
            if p[j, c.PROFILE] > 0.0:
                moves = p[j, c.SLOWNESS], p[j, c.PROFILE], dt
                target[j], rate[j] = _profiled(asked, last, rate[j], *moves)
            else:
                target[j] = _limited(asked, last, p[j, c.SLOWNESS], dt)
            error, slip, more = (1.0 - p[j, c.OPEN]) * (target[j] - motor[j]), -speed[j], 0.0
            if share[j] < 1.0:
                slip = -slow[j] - share[j] * (speed[j] - slow[j])
            if p[j, c.LEAD] > 0.0:
                own = rate[j] if p[j, c.PROFILE] > 0.0 else (target[j] - last) / dt
                known = len(given) > 0 and not np.isnan(given[n, j, 0])
                slip += p[j, c.LEAD] * (_between(given, n, then_n, part, j, 0) if known else own)
            if len(given) > 0:
                gain = p[j, c.KP] if p[j, c.OPEN] > 0.0 else 1.0
                more = gain * _between(given, n, then_n, part, j, 1)
            lossy = p[j, c.UNLIMITED] * p[j, c.KD]
            if _acts(t, p[j, c.HOLD], dt):
                if p[j, c.INTEGRAL] > 0.0 or p[j, c.CASCADE] > 0.0:
                    full = p[j, c.FULL] if p[j, c.FULL] > 0.0 else p[j, c.LIMIT]
                    for_s = max(p[j, c.HOLD], dt)
                    total[j] += (p[j, c.INTEGRAL] + p[j, c.CASCADE]) * p[j, c.KP] * for_s * error
                    total[j] += p[j, c.CASCADE] * p[j, c.KD] * for_s * slip
                    total[j] = min(max(total[j], -full), full)
                    more += total[j]
                law = p[j, c.KP], p[j, c.KD] - lossy, p[j, c.LIMIT], p[j, c.DEAD_ZONE]
                asked_nm[j], at_limit[j] = _pd(error, slip, more, speed[j], *law, p[j, c.FALL])
            pd = asked_nm[j] + lossy * slip
            pd = lagged[j] = lagged[j] + quick[j] * (pd - lagged[j])
            out[t + 1, 2, j] = pd
            if t == 0 and p[j, c.TWO_MASSES] == 0.0:
                out[0, 2, j] = pd
            cog = cogged(motor[j], p[j, c.COGGING], p[j, c.PERIOD], p[j, c.PHASE])
            if p[j, c.FADE] > 0.0 or p[j, c.SLIDING] > 0.0:
                kept = p[j, c.LIMIT], p[j, c.FADE], p[j, c.WARM], p[j, c.SLIDING], p[j, c.BRISTLE]
                memory = last_pd[j], dt, *kept, heat[j], bend[j]
                more, heat[j], bend[j] = remembered(speed[j], *memory)
                cog, last_pd[j] = cog + more, pd
            pd *= 1.0 - p[j, c.WEAK]
            rub[j] = p[j, c.COULOMB] + rubbing(speed[j], p[j, c.STICTION])
            explicit = at_limit[j] or p[j, c.HOLD] > dt
            loss = share[j] * quick[j] * (lossy if explicit else p[j, c.KD])
            loss += p[j, c.FALL] if at_limit[j] else 0.0
            loss = (1.0 - p[j, c.WEAK]) * loss + p[j, c.VISCOUS]
            if p[j, c.TWO_MASSES] > 0.0:
                gap, slip, r = motor[j] - q[j], speed[j] - v[j], dt / p[j, c.ROTOR]
                gear[j] = _gear(gap, slip, p[j, c.PLAY], p[j, c.STIFFNESS], p[j, c.TEETH])
                most = rub[j] + p[j, c.LOAD] * abs(gear[j])
                loss = loss if implicit else 0.0
                drag = p[j, c.VISCOUS], most, p[j, c.ONE_WAY], p[j, c.LOCK]
                speed[j] = _turned(speed[j], pd, cog, gear[j], *drag, r, loss)
                motor[j] += dt * speed[j]
                force[j], rub[j] = gear[j], 0.0
            else:
                changed |= at_limit[j] != held[j]
                held[j], damped[j] = at_limit[j], dt * loss
                force[j] = pd + cog - p[j, c.VISCOUS] * v[j]
                rub[j] += p[j, c.LOAD] * abs(gear[j])
        for j in range(joints if presses else 0):
            past = ends[j, 1] * (q[j] + (dt if implicit else 0.5 * dt) * v[j] - ends[j, 0])
            pressed[j] = np.sign(ends[j, 1]) * max(past, 0.0)
            pressed[j] += p[j, c.SPRING] * (q[j] - p[j, c.REST])
            stiff = dt * dt * abs(ends[j, 1]) if implicit and past > 0.0 else 0.0
            changed |= stiff != firm[j]
            firm[j] = stiff
        if changed:
            for j in range(joints):
                for n in range(joints):
                    inverse[j, n] = mass[i, j, n]
                inverse[j, j] += p[j, c.ROTOR] + damped[j] if p[j, c.TWO_MASSES] == 0.0 else 0.0
                inverse[j, j] += firm[j]
            _invert(inverse)
        rubs = False
        for j in range(joints):
            force[j] += push[m, j] - bias[i, j] - pressed[j]
            for n in range(0 if exact else joints):
                force[j] -= dq[i, j, n] * (q[n] - q_m[i, n]) + dv[i, j, n] * (v[n] - v_m[i, n])
            rubs |= rub[j] > 0.0 or (p[j, c.ONE_WAY] != 0.0 and p[j, c.TWO_MASSES] == 0.0)
        for j in range(joints):
            accel[j] = 0.0
            for n in range(joints):
                accel[j] += inverse[j, n] * force[n]
            if p[j, c.LOCK] > 0.0 and p[j, c.TWO_MASSES] == 0.0:
                slides = v[j] + dt * accel[j]
                if slides * out[t + 1, 2, j] <= 0.0 and slides * gear[j] < 0.0:
                    rub[j], rubs = rub[j] + p[j, c.LOCK], True
        for j in range(joints):
            after[j] = v[j] + dt * accel[j]
            for n in range(joints if rubs else 0):
                after[j] += inverse[j, n] * impulse[n]
        for _ in range((SWEEPS if joints > 1 else 1) if rubs else 0):
            settled = True
            for j in range(joints):
                most, way = dt * rub[j], dt * p[j, c.ONE_WAY] * (1.0 - p[j, c.TWO_MASSES])
                low, high = -most - max(way, 0.0), most + max(-way, 0.0)
                off = after[j] - slides_on[j] * v[j] + yielding[j] * impulse[j]
                more = impulse[j] - off / (inverse[j, j] + yielding[j])
                more = min(max(more, low), high) - impulse[j]
                if more != 0.0:
                    settled = False
                    impulse[j] += more
                    for n in range(joints):
                        after[n] += inverse[n, j] * more
            if settled:
                break
        for j in range(joints):
            accel[j] = (after[j] - v[j]) / dt
            v[j] = after[j]
            q[j] += dt * v[j]
        for j in range(joints):
            if p[j, c.TWO_MASSES] == 0.0:
                gear[j] = bias[i, j] + pressed[j] - push[m, j]
                for n in range(joints if p[j, c.LOAD] > 0.0 or p[j, c.LOCK] > 0.0 else 0):
                    gear[j] += mass[i, j, n] * accel[n] + dq[i, j, n] * (q[n] - q_m[i, n])
                motor[j], speed[j] = q[j], v[j]
            slow[j] += share[j] * (speed[j] - slow[j])
            out[t + 1, 0, j], out[t + 1, 1, j] = q[j], motor[j]
            if not abs(q[j]) + abs(motor[j]) < FAR_RAD:
                return False
    return True


UNTIL, THEN, FROM = range(3)
"""Which torque a sample has: of the tick until it, as simulators report; under the command until it
and with the motor as it is then, as a drive reads its current; or of the tick from it on."""


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _since(motor, dt, kp, kd, limit, slip_share, lag_share, pd):
    """What the PD torque `pd` of the last tick is after it; `motor` (3,): angles, the last ones."""
    if not abs(pd) < limit:
        return pd
    moved, before = motor[2] - motor[1], motor[1] - motor[0]
    pd -= lag_share * (kp * moved + slip_share * kd * (moved - before) / dt)
    return min(max(pd, -limit), limit)


@numba.njit(cache=True, error_model="numpy")
def sense(ticks, at, edges, at_motor, read, p, dt, shown):
    """Write means of what K joints show over blocks of samples into `shown` (B, 3, K).

    `ticks` (n + 1, 3, K): joint, motor and torque at the start and after every tick; `at` (T,): how
    many ticks every sample is after, broken; `edges` (B + 1,): first samples of the blocks;
    `at_motor` (K,): the side of the gear with the position sensor; `read`: `UNTIL`, `THEN`, `FROM`.
    """
    last = len(ticks) - 1
    for b in range(len(edges) - 1):
        count = edges[b + 1] - edges[b]
        for j in range(ticks.shape[2]):
            side = 1 if at_motor[j] else 0
            law = (1.0 - p[j, c.OPEN]) * p[j, c.KP], p[j, c.KD], p[j, c.LIMIT]
            shares = dt / (p[j, c.FILTER] + dt), dt / (p[j, c.LAG] + dt)
            angle = motor = torque = once = 0.0
            for k in range(edges[b], edges[b + 1]):
                now = min(int(np.round(at[k])), last)
                motor += ticks[now, 1, j]
                pd = ticks[min(now + (read == FROM), last), 2, j]
                if read == THEN and now > 1 and p[j, c.HOLD] <= dt:
                    pd = _since(ticks[now - 2 : now + 1, 1, j], dt, *law, *shares, pd)
                torque += pd
                if p[j, LATE] > 0.0:
                    then = min(max(at[k] - p[j, LATE] / dt, 0.0), float(last))
                    low = min(int(then), last - 1)
                    share = then - low
                    seen = ticks[low, side, j] * (1.0 - share) + ticks[low + 1, side, j] * share
                else:
                    seen = ticks[now, side, j]
                seen += p[j, ZERO]
                angle += seen
                if p[j, ONCE] != 0.0 or p[j, ACROSS] != 0.0:
                    once += p[j, ONCE] * np.cos(seen) + p[j, ACROSS] * np.sin(seen)
            shown[b, 0, j] = (1.0 + p[j, SCALE]) * angle / count + p[j, BIAS] + once / count
            shown[b, 1, j], shown[b, 2, j] = motor / count, torque / count
