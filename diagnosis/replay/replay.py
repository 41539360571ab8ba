"""Replay: what a mechanism does with a log's commands and pushes, in compiled numpy.

The same drive law, command path and position sensors as in every engine, on the rigid dynamics of
`chain`. Nothing here is random: lost packets, noise and the steps of an encoder are not replayed,
they are recognised from a log by themselves.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numba
import numpy as np

from backends.command import follow, ring_ticks
from backends.drive import drive_table, motor_tick
from backends.encoder import note, read
from backends.spec import Command, Encoder, Hand, Spec
from backends.state import Array
from diagnosis.replay.chain import chain, dynamics, solve, workspace
from diagnosis.replay.expansion import accelerate, expand

CHANNELS = ("position", "motor", "velocity", "torque")
"""What a replay gives, in this order."""


@dataclass(frozen=True, kw_only=True)
class Commands:
    """What was asked of J joints in one episode, a row per sample."""

    ticks: Array
    """Drive periods from the start to each sample, shape (T,)."""
    target: Array
    """Commanded angle from each sample on [rad], shape (T, J)."""
    load: Array
    """External torque on the joint from each sample on [Nm], shape (T, J)."""
    start: Array
    """What the sensors read at rest at the start [rad], shape (J,)."""

    def first(self, samples: int) -> "Commands":
        """The first samples alone."""
        return dataclasses.replace(
            self,
            ticks=self.ticks[:samples],
            target=self.target[:samples],
            load=self.load[:samples],
        )


@numba.njit(cache=True)
def _sense(at_motor, motor, joint, angle):
    """Write the angles (1, J) where the sensors sit."""
    for j in range(len(joint)):
        angle[0, j] = motor[j] if at_motor[j] else joint[j]


@numba.njit(cache=True)
def _replay(ticks, target, load, start, chain_, drive, path, encoder, at_motor, dt, rings, out):
    samples, joints = target.shape
    q, qd = start.copy(), np.zeros(joints)
    motor, speed = start.copy(), np.zeros(joints)
    mass, bias = np.zeros((joints, joints)), np.zeros(joints)
    torque, acceleration, pd = np.zeros(joints), np.zeros(joints), np.zeros(joints)
    kept, wanted, angle, reading = np.zeros((4, 1, joints))
    age, seed = np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    work = workspace(len(chain_[0]), joints)
    weights = expand(chain_)
    closed = len(weights[0]) > 0
    late, read_late = path.any(), encoder.any()
    for k in range(samples):
        _sense(at_motor, motor, q, angle)
        if read_late:
            note(angle, age, rings[1])
            read(age, seed, encoder, dt, rings[1], reading)
        for j in range(joints):
            out[k, 0, j] = reading[0, j] if read_late else angle[0, j]
            out[k, 1, j], out[k, 2, j], out[k, 3, j] = motor[j], qd[j], pd[j]
            if not late:
                wanted[0, j] = target[k, j]
        if k + 1 == samples:
            break
        for _ in range(ticks[k + 1] - ticks[k]):
            if late:
                follow(target[k : k + 1], age, 1, seed, path, dt, kept, rings[0], wanted)
            for j in range(joints):
                motor[j], speed[j], pd[j], torque[j] = motor_tick(
                    wanted[0, j], q[j], qd[j], motor[j], speed[j], drive[j], dt
                )
                torque[j] += load[k, j]
            if closed:
                accelerate(q, qd, torque, weights[0], weights[1], acceleration)
            else:
                dynamics(q, qd, chain_, work, mass, bias)
                solve(mass, torque - bias, acceleration)
            for j in range(joints):
                qd[j] += dt * acceleration[j]
                q[j] += dt * qd[j]
            age[0] += 1
            if read_late:
                _sense(at_motor, motor, q, angle)
                note(angle, age, rings[1])


def replay(spec: Spec, commands: Commands) -> Array:
    """What the mechanism of `spec` would have shown: shape (4, T, J), `CHANNELS` first.

    Positions [rad] are what its sensors read, torques [Nm] those of the PD law.
    """
    return replays(spec, (commands,))[0]


def replays(spec: Spec, episodes: Sequence[Commands]) -> list[Array]:
    """See `replay`, for several episodes."""
    joints = [body.joint for body in spec.hand.driven]
    path = np.array([[_numbers(j.command) for j in joints]])
    path[..., 2] = 0.0
    encoder = np.array([[_numbers(j.encoder) for j in joints]])
    encoder[..., 2:4] = 0.0
    dt_s = spec.timing.drive_s
    ticks = [ring_ticks(delay, dt_s) for delay in (path[..., 0], encoder[..., 4])]
    numbers, drives = chain(spec).numbers, drive_table(spec)
    at_motor = np.array([j.sensor == "motor" for j in joints])
    shown = []
    for one in episodes:
        start = (one.start - encoder[0, :, 0]) / (1.0 + encoder[0, :, 1])
        rings = tuple(np.zeros((1, len(joints), count)) for count in ticks)
        out = np.zeros((len(one.target), len(CHANNELS), len(joints)))
        _replay(
            *(one.ticks, one.target, one.load, start, numbers, drives, path, encoder),
            *(at_motor, dt_s, rings, out),
        )
        shown.append(out.transpose(1, 0, 2))
    return shown


def _numbers(part: Command | Encoder) -> list[float]:
    """The numbers of a part of the spec in field order."""
    return [getattr(part, f.name) for f in fields(part)]


def link_inertias_kgm2(spec: Spec) -> Array:
    """What each joint turns beside its rotor, stretched out [kg m2, on a slide kg], shape (J,)."""
    numbers, joints = chain(spec).numbers, len(spec.drives)
    mass, bias, still = np.zeros((joints, joints)), np.zeros(joints), np.zeros(joints)
    dynamics(still, still, numbers, workspace(len(numbers[0]), joints), mass, bias)
    return np.diag(mass).copy()


def limbs(spec: Spec) -> tuple[Spec, ...]:
    """The parts of a mechanism that move independently of each other in free air: its fingers."""
    groups: dict[str, list] = {}
    root: dict[str, str] = {}
    for body in spec.hand.bodies:
        root[body.name] = body.name if body.parent is None else root[body.parent]
        groups.setdefault(root[body.name], []).append(body)
    moving = [g for g in groups.values() if any(b.joint.drive is not None for b in g)]
    return tuple(dataclasses.replace(spec, hand=_part(spec.hand, tuple(g))) for g in moving)


def _part(hand: Hand, bodies: tuple) -> Hand:
    names = {body.name for body in bodies}
    tips = tuple(tip for tip in hand.fingertips if tip.body in names)
    return dataclasses.replace(hand, bodies=bodies, fingertips=tips)
