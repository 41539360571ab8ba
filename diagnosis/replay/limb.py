"""A limb in motion, compiled: worlds of it side by side, from sample to sample.

What replays and the decoding of lost packets share. The worlds have equal numbers and differ in the
targets that reached them. Nothing here is random: lost packets, noise and the steps of an encoder
are left out.
"""

from functools import lru_cache

import numba
import numpy as np

from backends.command import follow, ring_ticks
from backends.drive import drive_table, motor_tick
from backends.encoder import note, read
from backends.spec import Spec
from backends.state import Array
from diagnosis.replay.chain import Chain, chain, dynamics, solve, workspace
from diagnosis.replay.expansion import accelerate_one, accelerate_two, expand, turned, wave

CHANNELS = ("position", "motor", "torque", "velocity")
"""What a limb shows, in this order: positions as its sensors read them, torques of the PD law."""
JOINT, SPEED, MOTOR, MOTOR_SPEED, TORQUE, KEPT, WANTED = range(7)
"""Rows of a world's state: angles and speeds of joints and motors, the last PD torques, and the
targets that its command path has kept and let through."""
DELAY = 4
"""Column of an encoder's numbers."""


def numbers(spec: Spec, worlds: int = 1) -> tuple:
    """A limb as the compiled code takes it.

    Bodies, their closed form, drives, command paths and sensors of all worlds, the period [s].
    """
    joints = [body.joint for body in spec.hand.driven]
    path = np.array([[list(vars(j.command).values()) for j in joints]] * worlds)
    encoder = np.array([[list(vars(j.encoder).values()) for j in joints]] * worlds)
    path[..., 2], encoder[..., 2:4] = 0.0, 0.0
    at_motor = np.array([j.sensor == "motor" for j in joints])
    bodies, dt_s = chain(spec), spec.timing.drive_s
    return bodies.numbers, _closed(bodies), drive_table(spec), path, encoder, at_motor, dt_s


@lru_cache(maxsize=256)
def _closed(bodies: Chain) -> Array:
    return expand(bodies.numbers)


def memory(limb: tuple) -> tuple:
    """What late commands and late readings need to remember, each (W, J, ticks)."""
    path, encoder, dt_s = limb[3], limb[4], limb[6]
    late_s = path[..., 0], encoder[..., 4]
    return tuple(np.zeros((*delay.shape, ring_ticks(delay, dt_s))) for delay in late_s)


@numba.njit(cache=True, error_model="numpy")
def rest(start, limb):
    """The state (W, 7, J) of worlds at rest whose sensors read `start` (J,)."""
    encoder = limb[4]
    state = np.zeros((len(encoder), 7, len(start)))
    for w in range(len(encoder)):
        state[w, JOINT] = (start - encoder[w, :, 0]) / (1.0 + encoder[w, :, 1])
        state[w, MOTOR] = state[w, JOINT]
    return state


@numba.njit(cache=True, error_model="numpy")
def run(ticks, target, load, alive, limb, rings, state, age, out):
    """Take the worlds that are alive (W,) through n samples and write what each of them shows.

    `ticks` (n,), targets (n, W, J) and `load` (n, J) are of the time up to each sample; `age` (W,)
    counts ticks; `out` is (n, W, 4, J).
    """
    if is_closed(limb) and not limb[3].any() and not limb[4][..., DELAY].any():
        _run_in_time(ticks, target, load, alive, limb, state, out)
        age += ticks.sum()
    else:
        _run(ticks, target, load, alive, limb, rings, state, age, out)


@numba.njit(cache=True, error_model="numpy")
def is_closed(limb):
    """Whether motion is in closed form: of one or two joints, see `expand`."""
    return len(limb[1]) > 0


@numba.njit(cache=True, error_model="numpy")
def _run_in_time(ticks, target, load, alive, limb, state, out):
    """`run` in closed form where nothing is late."""
    _, closed, drive, _, encoder, at_motor, dt = limb
    last = len(at_motor) - 1
    drives = _drive(drive, 0), _drive(drive, last)
    for w in range(len(alive)):
        if alive[w]:
            mine, shown, own = target[:, w], out[:, w], _limb(state[w], last)
            for k in range(len(ticks)):
                own = _span(ticks[k], own, _asked(mine, load, k, last), last, drives, closed, dt)
                own = _arrived(own, shown, k, at_motor, encoder)
            _keep(state[w], last, own)


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _span(ticks, own, asked, last, drives, closed, dt):
    """A limb some ticks later."""
    for _ in range(ticks if last == 0 else 0):
        own = _one(own, asked, drives, closed, dt)
    for _ in range(0 if last == 0 else ticks):
        own = _two(own, asked, drives, closed, dt)
    return own


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _arrived(own, out, k, at_motor, encoder):
    """A limb at the end of a sample, which it shows; its waves begin anew."""
    last = len(at_motor) - 1
    _show(out, k, last, own[1], at_motor, encoder)
    _show(out, k, 0, own[0], at_motor, encoder)
    return _waves(own[0]), _waves(own[1])


@numba.njit(cache=True, error_model="numpy")
def _asked(target, load, k, last):
    """Targets and loads of the first and the last joint up to a sample."""
    return (target[k, 0], target[k, last]), (load[k, 0], load[k, last])


@numba.njit(cache=True, error_model="numpy")
def _waves(joint):
    angle, speed, motor, rate, pd, _ = joint
    return angle, speed, motor, rate, pd, wave(angle)


@numba.njit(cache=True, error_model="numpy")
def _show(out, k, j, joint, at_motor, encoder):
    angle, speed, motor, _, torque, _ = joint
    sensed = motor if at_motor[j] else angle
    out[k, 0, j] = (1.0 + encoder[0, j, 1]) * sensed + encoder[0, j, 0]
    out[k, 1, j], out[k, 2, j], out[k, 3, j] = motor, torque, speed


@numba.njit(cache=True, error_model="numpy")
def _run(ticks, target, load, alive, limb, rings, state, age, out):
    """`run` of any limb. One long loop: handing on an array costs as much as a third of a tick."""
    bodies, coefficients, drive, path, encoder, at_motor, dt = limb
    worlds, _, joints = state.shape
    torque, acceleration, bias = np.zeros((3, joints))
    mass, seed = np.zeros((joints, joints)), np.zeros(worlds, dtype=np.int64)
    angle, reading, cosine, sine = np.zeros((4, worlds, joints))
    kept, wanted = state[:, KEPT], state[:, WANTED]
    work = workspace(len(bodies[0]), joints)
    closed, late, read_late = is_closed(limb), path.any(), encoder.any()
    for k in range(len(ticks)):
        for w in range(worlds):
            for j in range(0 if late else joints):
                wanted[w, j] = target[k, w, j]
            for j in range(joints if closed else 0):
                cosine[w, j], sine[w, j] = wave(state[w, JOINT, j])
        for _ in range(ticks[k]):
            if late:
                follow(target[k], age, 1, seed, path, dt, kept, rings[0], wanted)
            for w in range(worlds):
                if not alive[w]:
                    continue
                for j in range(joints):
                    motor, speed, pd, gear = motor_tick(
                        *(wanted[w, j], state[w, JOINT, j], state[w, SPEED, j]),
                        *(state[w, MOTOR, j], state[w, MOTOR_SPEED, j]),
                        _drive(drive, j),
                        dt,
                    )
                    state[w, MOTOR, j], state[w, MOTOR_SPEED, j] = motor, speed
                    state[w, TORQUE, j], torque[j] = pd, gear + load[k, j]
                if not closed:
                    dynamics(state[w, JOINT], state[w, SPEED], bodies, work, mass, bias)
                    solve(mass, torque - bias, acceleration)
                elif joints == 1:
                    own = cosine[w, 0], sine[w, 0]
                    acceleration[0] = accelerate_one(own, torque[0], coefficients, 0, 1)
                else:
                    acceleration[0], acceleration[1] = accelerate_two(
                        *((cosine[w, 0], sine[w, 0]), (cosine[w, 1], sine[w, 1])),
                        *(state[w, SPEED, 0], state[w, SPEED, 1]),
                        *(torque[0], torque[1]),
                        *(coefficients, 0, 1),
                    )
                for j in range(joints):
                    state[w, SPEED, j] += dt * acceleration[j]
                    move = dt * state[w, SPEED, j]
                    state[w, JOINT, j] += move
                    if closed:
                        own = cosine[w, j], sine[w, j]
                        cosine[w, j], sine[w, j] = turned(own, state[w, JOINT, j], move)
            for w in range(worlds):
                age[w] += 1
            if read_late:
                _sense(state, at_motor, angle)
                note(angle, age, rings[1])
        if read_late:
            _sense(state, at_motor, angle)
            note(angle, age, rings[1])
            read(age, seed, encoder, dt, rings[1], reading)
        for w in range(worlds):
            for j in range(joints):
                sensed = state[w, MOTOR, j] if at_motor[j] else state[w, JOINT, j]
                out[k, w, 0, j] = reading[w, j] if read_late else sensed
                out[k, w, 1, j], out[k, w, 2, j] = state[w, MOTOR, j], state[w, TORQUE, j]
                out[k, w, 3, j] = state[w, SPEED, j]


@numba.njit(cache=True, error_model="numpy")
def _joint(s, j):
    angle = s[JOINT, j]
    return angle, s[SPEED, j], s[MOTOR, j], s[MOTOR_SPEED, j], s[TORQUE, j], wave(angle)


@numba.njit(cache=True, error_model="numpy")
def _limb(state, last):
    """The first and the last joint; of a lone joint the same twice."""
    return _joint(state, 0), _joint(state, last)


@numba.njit(cache=True, error_model="numpy")
def _keep(s, last, own):
    for j, joint in ((last, own[1]), (0, own[0])):
        s[JOINT, j], s[SPEED, j], s[MOTOR, j], s[MOTOR_SPEED, j], s[TORQUE, j], _ = joint


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _one(own, asked, drives, closed, dt):
    """Take a lone joint through one tick. Inline: a call would pass its numbers through memory."""
    (q, speed, motor, rate, pd, at), other = own
    targets, loads = asked
    motor, rate, pd, gear = motor_tick(targets[0], q, speed, motor, rate, drives[0], dt)
    speed += dt * accelerate_one(at, gear + loads[0], closed, 0, 1)
    q += dt * speed
    return (q, speed, motor, rate, pd, turned(at, q, dt * speed)), other


@numba.njit(cache=True, error_model="numpy", forceinline=True)
def _two(own, asked, drives, closed, dt):
    """Take two joints through one tick, see `_one`."""
    (q, speed, motor, rate, pd, at), (q2, speed2, motor2, rate2, pd2, at2) = own
    targets, loads = asked
    motor, rate, pd, gear = motor_tick(targets[0], q, speed, motor, rate, drives[0], dt)
    motor2, rate2, pd2, gear2 = motor_tick(targets[1], q2, speed2, motor2, rate2, drives[1], dt)
    torques = gear + loads[0], gear2 + loads[1]
    moved, moved2 = accelerate_two(at, at2, speed, speed2, *torques, closed, 0, 1)
    speed, speed2 = speed + dt * moved, speed2 + dt * moved2
    q, q2 = q + dt * speed, q2 + dt * speed2
    first = q, speed, motor, rate, pd, turned(at, q, dt * speed)
    return first, (q2, speed2, motor2, rate2, pd2, turned(at2, q2, dt * speed2))


@numba.njit(cache=True, error_model="numpy")
def _sense(state, at_motor, angle):
    """Write the angles (W, J) where the sensors sit."""
    for w in range(len(state)):
        for j in range(len(at_motor)):
            angle[w, j] = state[w, MOTOR, j] if at_motor[j] else state[w, JOINT, j]


@numba.njit(cache=True, error_model="numpy")
def _drive(t, j):
    """A drive's numbers; as a tuple they cost nothing to pass, as a row they would be counted."""
    return (
        *(t[j, 0], t[j, 1], t[j, 2], t[j, 3], t[j, 4], t[j, 5], t[j, 6]),
        *(t[j, 7], t[j, 8], t[j, 9], t[j, 10], t[j, 11], t[j, 12]),
    )
