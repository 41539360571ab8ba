"""Replay: simulate a mechanism under a log's commands and pushes, in compiled code.

Drive law, command path and position sensors are those of every engine; the rigid dynamics are those
of `chain`. Random effects are not replayed; they are detected directly in a log.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.replay.arrival import arrivals, looked
from diagnosis.replay.chain import chain, dynamics, workspace
from diagnosis.replay.lanes import together
from diagnosis.replay.limb import CHANNELS, DELAY, is_closed, memory, numbers, rest, run


@dataclass(frozen=True, kw_only=True)
class Commands:
    """The commands of J joints in one episode, a row per sample."""

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


@dataclass(frozen=True, kw_only=True)
class Batch:
    """The commands of E episodes end to end, for compiled code; N samples in total."""

    begin: Array
    """Where episodes begin, and the end, shape (E + 1,)."""
    ticks: Array
    """Drive periods of the time up to each sample, shape (N,)."""
    target: Array
    """Commanded angles of that time [rad], shape (N, J)."""
    load: Array
    """External torques of that time [Nm], shape (N, J)."""
    start: Array
    """What the sensors read at rest at the starts [rad], shape (E, J)."""

    @classmethod
    def of(cls, episodes: Sequence[Commands]) -> "Batch":
        """The commands of one or more episodes."""
        ticks, target, load = (
            np.concatenate(parts) for parts in zip(*map(_until, episodes), strict=True)
        )
        lengths = [len(one.ticks) for one in episodes]
        return cls(
            begin=np.cumsum([0, *lengths]),
            ticks=ticks,
            target=target,
            load=load,
            start=np.array([one.start for one in episodes]),
        )


def _until(one: Commands) -> tuple[Array, Array, Array]:
    """Ticks (T,), targets and loads (T, J) of the time up to each sample."""
    before = np.maximum(np.arange(len(one.ticks)) - 1, 0)
    ticks = np.diff(one.ticks, prepend=one.ticks[:1])
    return ticks, one.target[before], one.load[before]


def replay(spec: Spec, commands: Commands) -> Array:
    """The readings of the mechanism of `spec`, shape (4, T, J) with `limb.CHANNELS` first."""
    return replays(spec, Batch.of((commands,)))[0]


def replays(spec: Spec, batch: Batch) -> list[Array]:
    """See `replay`, for every episode."""
    limb, episodes = numbers(spec), tuple(vars(batch).values())
    if is_closed(limb):
        shown = _in_closed_form(episodes, limb)
    else:
        shown = _tick_by_tick(episodes, limb, memory(limb))
    return [shown[a:b].transpose(1, 0, 2) for a, b in pairwise(batch.begin)]


@numba.njit(cache=True, error_model="numpy")
def _tick_by_tick(episodes, limb, rings):
    """What is shown, (N, 4, J)."""
    begin, ticks, target, load, start = episodes
    out = np.zeros((len(ticks), 1, len(CHANNELS), start.shape[1]))
    for e in range(len(start)):
        alone, age = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64)
        a, b = begin[e], begin[e + 1]
        now = ticks[a:b], np.expand_dims(target[a:b], 1), load[a:b]
        run(*now, alone, limb, rings, rest(start[e], limb), age, out[a:b])
    return out[:, 0]


@numba.njit(cache=True, error_model="numpy")
def _in_closed_form(episodes, limb):
    """`_tick_by_tick` of all episodes at a time."""
    begin, ticks, target, load, start = episodes
    _, closed, drive, path, encoder, at_motor, dt = limb
    path, encoder = path[0], encoder[0]
    shown = np.zeros((len(ticks), len(CHANNELS), len(at_motor)))
    angle = (start - encoder[:, 0]) / (1.0 + encoder[:, 1])
    if path.any() or encoder[:, DELAY].any():
        _late(episodes, angle, limb, shown)
    else:
        anew = np.ones(len(ticks), np.bool_)
        together(begin, (ticks, anew, target, load), angle, drive, closed, at_motor, dt, shown)
    for j in range(len(encoder)):
        shown[:, 0, j] = (1.0 + encoder[j, 1]) * shown[:, 0, j] + encoder[j, 0]
    return shown


@numba.njit(cache=True, error_model="numpy")
def _late(episodes, angle, limb, shown):
    """Write what is shown where commands or readings are late, see `arrivals`."""
    begin, ticks, target, load, start = episodes
    _, closed, drive, path, encoder, at_motor, dt = limb
    late = encoder[0, :, DELAY]
    parts = [
        arrivals(ticks[begin[e] : begin[e + 1]], target[begin[e] : begin[e + 1]], path[0], late, dt)
        for e in range(len(start))
    ]
    ends = np.cumsum(np.array([0] + [len(part[0]) for part in parts]))
    spans, anew = np.zeros(ends[-1], np.int64), np.ones(ends[-1], np.bool_)
    wanted, pushed = np.zeros((ends[-1], len(at_motor))), np.zeros((ends[-1], len(at_motor)))
    moved = np.zeros((ends[-1], *shown.shape[1:]))
    for e in range(len(start)):
        a, b = ends[e], ends[e + 1]
        spans[a:b], samples, wanted[a:b], _ = parts[e]
        anew[a + 1 : b] = samples[1:] != samples[:-1]
        pushed[a:b] = load[begin[e] : begin[e + 1]][samples]
    together(ends, (spans, anew, wanted, pushed), angle, drive, closed, at_motor, dt, moved)
    for e in range(len(start)):
        own, out = moved[ends[e] : ends[e + 1]], shown[begin[e] : begin[e + 1]]
        some, ended = ticks[begin[e] : begin[e + 1]], parts[e][3]
        out[:] = own[ended[np.cumsum(some)]]
        looked(some, late / dt, ended, own[:, 0], out[:, 0])


def link_inertias_kgm2(spec: Spec) -> Array:
    """Inertia that each joint moves besides its rotor, arm stretched [kg m2, slides kg], (J,)."""
    numbers, joints = chain(spec).numbers, len(spec.drives)
    mass, bias, still = np.zeros((joints, joints)), np.zeros(joints), np.zeros(joints)
    dynamics(still, still, numbers, workspace(len(numbers[0]), joints), mass, bias)
    return np.diag(mass).copy()
