"""Replay a limb in compiled code: several worlds at once, from sample to sample.

Replays and the decoding of lost packets share this module. The worlds have equal numbers and differ
in the targets that reached them. Nothing here is random: lost packets, noise and encoder steps are
left out.
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
"""Outputs of a limb, in order. Positions are those that its sensors read, torques those of the PD
law."""
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
    """Memory of late commands and late readings, each (W, J, ticks)."""
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
def is_closed(limb):
    """Whether motion is in closed form: of one or two joints, see `expand`."""
    return len(limb[1]) > 0


@numba.njit(cache=True, error_model="numpy")
def run(ticks, target, load, alive, limb, rings, state, age, out):
    """Step the worlds that are alive (W,) through n samples and write the outputs of each.

    `ticks` (n,), targets (n, W, J) and `load` (n, J) are of the time up to each sample; `age` (W,)
    counts ticks; `out` is (n, W, 4, J). One long loop: handing on an array costs as much as a third
    of a tick.
    """
    bodies, coefficients, drive, path, encoder, at_motor, dt = limb
    worlds, _, joints = state.shape
    torque, acceleration, bias = np.zeros(joints), np.zeros(joints), np.zeros(joints)
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
