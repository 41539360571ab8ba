"""Replay: what a mechanism does with a log's commands and pushes, in compiled numpy.

The same drive law, command path and position sensors as in every engine, on the rigid dynamics of
`chain`. What is random is not replayed, it is recognised from a log by itself.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest

import numba
import numpy as np

from backends.spec import Hand, Spec
from backends.state import Array
from diagnosis.replay.arrival import arrivals, looked
from diagnosis.replay.chain import chain, dynamics, workspace
from diagnosis.replay.limb import CHANNELS, DELAY, abreast, is_closed, memory, numbers, rest, run


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

    @cached_property
    def until(self) -> tuple[Array, Array, Array]:
        """Ticks (T,), targets and loads (T, J) of the time up to each sample."""
        before = np.maximum(np.arange(len(self.ticks)) - 1, 0)
        ticks = np.diff(self.ticks, prepend=self.ticks[:1])
        return ticks, self.target[before], self.load[before]

    def first(self, samples: int) -> "Commands":
        """The first samples alone."""
        return dataclasses.replace(
            self,
            ticks=self.ticks[:samples],
            target=self.target[:samples],
            load=self.load[:samples],
        )


def replay(spec: Spec, commands: Commands) -> Array:
    """What the mechanism of `spec` would have shown: shape (4, T, J), `limb.CHANNELS` first."""
    return replays(spec, (commands,))[0]


def replays(spec: Spec, episodes: Sequence[Commands]) -> list[Array]:
    """See `replay`, for several episodes."""
    limb = numbers(spec)
    shown: list[Array] = []
    if is_closed(limb):
        for one, other in zip_longest(episodes[::2], episodes[1::2]):
            second = one.first(0) if other is None else other
            shown += _in_closed_form(one.until, one.start, second.until, second.start, limb)
    else:
        rings = memory(limb)
        shown += [_tick_by_tick(one.until, one.start, limb, rings) for one in episodes]
    return [out.transpose(1, 0, 2) for out in shown[: len(episodes)]]


@numba.njit(cache=True, error_model="numpy")
def _tick_by_tick(until, start, limb, rings):
    ticks, target, load = until
    out = np.zeros((len(ticks), 1, len(CHANNELS), len(start)))
    alone, age = np.ones(1, dtype=np.bool_), np.zeros(1, dtype=np.int64)
    now = ticks, np.expand_dims(target, 1), load
    run(*now, alone, limb, rings, rest(start, limb), age, out)
    return out[:, 0]


@numba.njit(cache=True, error_model="numpy")
def _in_closed_form(until, start, until_b, start_b, limb):
    """Two episodes at a time."""
    bodies, closed, drive, path, encoder, at_motor, dt = limb
    blind = bodies, closed, drive, path, 0.0 * encoder, at_motor, dt
    (one, ends), (other, ends_b) = _track(until, start, limb), _track(until_b, start_b, limb)
    abreast(one, other, blind)
    return _seen(until[0], one[-1], ends, limb), _seen(until_b[0], other[-1], ends_b, limb)


@numba.njit(cache=True, error_model="numpy")
def _track(until, start, limb):
    """An episode for `abreast`, and the spans that end after so many ticks, see `arrivals`."""
    ticks, target, load = until
    path, late, dt = limb[3][0], limb[4][0, :, DELAY], limb[6]
    if path.any() or late.any():
        spans, samples, wanted, ends = arrivals(ticks, target, path, late, dt)
    else:
        samples = np.arange(len(ticks))
        spans, wanted, ends = ticks, target, samples
    out = np.zeros((len(spans), len(CHANNELS), len(start)))
    return (spans, samples, wanted, load, rest(start, limb)[0], out), ends


@numba.njit(cache=True, error_model="numpy")
def _seen(ticks, shown, ends, limb):
    """What position sensors make of the motion that they sense, and the rest as it is."""
    path, encoder, dt = limb[3][0], limb[4][0], limb[6]
    late = encoder[:, DELAY] / dt
    if path.any() or late.any():
        out = shown[ends[np.cumsum(ticks)]]
        looked(ticks, late, ends, shown[:, 0], out[:, 0])
    else:
        out = shown
    for j in range(len(encoder)):
        out[:, 0, j] = (1.0 + encoder[j, 1]) * out[:, 0, j] + encoder[j, 0]
    return out


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
