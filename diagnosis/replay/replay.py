"""Replay: simulate a mechanism under a log's commands and pushes, in compiled code.

Drive law, command path and position sensors are those of every engine; the rigid dynamics are those
of `chain`. Random effects are not replayed; they are detected directly in a log.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numba
import numpy as np

from backends.command import rounded
from backends.drive import drive_table
from backends.encoder import angles
from backends.spec import Command, Encoder, Spec
from backends.state import Array
from diagnosis.replay.arrival import arrivals, looked
from diagnosis.replay.chain import Chain, chain
from diagnosis.replay.expansion import expand
from diagnosis.replay.lanes import CHANNELS, together

PATH = tuple(field.name for field in dataclasses.fields(Command))
STEP = PATH.index("resolution_rad")
LATER = [PATH.index(name) for name in ("loss_share", "resolution_rad", "jitter_s")]
"""Columns of a path's numbers; those of LATER are random, or done before."""
ENCODER = tuple(field.name for field in dataclasses.fields(Encoder))
BIAS, SCALE, DELAY = (ENCODER.index(name) for name in ("bias_rad", "scale_error", "delay_s"))
ONCE, ACROSS = (ENCODER.index(f"eccentricity_{name}") for name in ("rad", "sine_rad"))
"""Columns of an encoder's numbers."""
RANDOM = [ENCODER.index(name) for name in ("resolution_rad", "noise_rad")]


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


def is_closed(spec: Spec) -> bool:
    """Whether a limb is replayed here: of one or two joints, see `expand`."""
    return len(_closed(chain(spec))) > 0


@lru_cache(maxsize=256)
def _closed(bodies: Chain) -> Array:
    return expand(bodies.numbers)


def replay(spec: Spec, commands: Commands) -> Array:
    """The readings of the mechanism of `spec`, shape (4, T, J) with `lanes.CHANNELS` first."""
    return replays(spec, Batch.of((commands,)))[0]


def replays(spec: Spec, batch: Batch) -> list[Array]:
    """See `replay`, for every episode; of limbs that are closed alone."""
    joints = [body.joint for body in spec.hand.driven]
    path = np.array([list(vars(j.command).values()) for j in joints])
    batch = dataclasses.replace(batch, target=rounded(batch.target, path[:, STEP]))
    encoder = np.array([list(vars(j.encoder).values()) for j in joints])
    path[:, LATER], encoder[:, RANDOM] = 0.0, 0.0
    at_motor = np.array([j.sensor == "motor" for j in joints])
    drive, closed = drive_table(spec), _closed(chain(spec))
    limb = closed, drive, path, encoder, at_motor, spec.timing.drive_s
    angle = angles(batch.start, *encoder[:, [BIAS, SCALE, ONCE, ACROSS]].T)
    shown = _in_closed_form(tuple(vars(batch).values()), angle, limb)
    return [shown[a:b].transpose(1, 0, 2) for a, b in pairwise(batch.begin)]


@numba.njit(cache=True, error_model="numpy")
def _in_closed_form(episodes, angle, limb):
    """What is shown of all episodes at a time, (N, 4, J), from rest at angles (E, J)."""
    begin, ticks, target, load, start = episodes
    closed, drive, path, encoder, at_motor, dt = limb
    shown = np.zeros((len(ticks), len(CHANNELS), len(at_motor)))
    if path.any() or encoder[:, DELAY].any():
        _late(episodes, angle, limb, shown)
    else:
        anew = np.ones(len(ticks), np.bool_)
        together(begin, (ticks, anew, target, load), angle, drive, closed, at_motor, dt, shown)
    for j in range(len(encoder)):
        seen = shown[:, 0, j].copy()
        shown[:, 0, j] = (1.0 + encoder[j, SCALE]) * seen + encoder[j, BIAS]
        if encoder[j, ONCE] != 0.0 or encoder[j, ACROSS] != 0.0:
            shown[:, 0, j] += encoder[j, ONCE] * np.cos(seen) + encoder[j, ACROSS] * np.sin(seen)
    return shown


@numba.njit(cache=True, error_model="numpy")
def _late(episodes, angle, limb, shown):
    """Write what is shown where commands or readings are late, see `arrivals`."""
    begin, ticks, target, load, start = episodes
    closed, drive, path, encoder, at_motor, dt = limb
    late = encoder[:, DELAY]
    parts = [
        arrivals(ticks[begin[e] : begin[e + 1]], target[begin[e] : begin[e + 1]], path, late, dt)
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
