"""Replay: what a mechanism does with a log's commands and pushes, in compiled numpy.

The same drive law, command path and position sensors as in every engine, on the rigid dynamics of
`chain`. What is random is not replayed, it is recognised from a log by itself.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from backends.spec import Hand, Spec
from backends.state import Array
from diagnosis.replay.arrival import arrivals
from diagnosis.replay.chain import chain, dynamics, workspace
from diagnosis.replay.limb import CHANNELS, is_closed, memory, numbers, rest, run, run_in_time


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


@numba.njit(cache=True, error_model="numpy")
def _replay(ticks, target, load, start, limb, rings, out):
    state, age = rest(start, limb), np.zeros(1, dtype=np.int64)
    alone = np.ones(1, dtype=np.bool_)
    run(ticks[:1] - ticks[:1], target[:1], load[:1], alone, limb, rings, state, age, out[:1])
    spans, path = np.diff(ticks), limb[3]
    if len(spans) == 0 or not path.any() or not is_closed(limb):
        run(spans, target[:-1], load[:-1], alone, limb, rings, state, age, out[1:])
        return
    parts, wanted, samples, ends = arrivals(spans, target[:-1, 0], path[0], limb[6])
    shown = np.zeros((len(parts), *out.shape[1:]))
    run_in_time(parts, wanted[:, None], load[samples], alone, limb, state, shown)
    out[1:] = shown[ends]


def replay(spec: Spec, commands: Commands) -> Array:
    """What the mechanism of `spec` would have shown: shape (4, T, J), `limb.CHANNELS` first."""
    return replays(spec, (commands,))[0]


def replays(spec: Spec, episodes: Sequence[Commands]) -> list[Array]:
    """See `replay`, for several episodes."""
    limb, shown = numbers(spec), []
    rings = memory(limb)
    for one in episodes:
        out = np.zeros((len(one.target), 1, len(CHANNELS), len(spec.drives)))
        target = one.target[:, None]
        _replay(one.ticks, target, one.load, one.start, limb, rings, out)
        shown.append(out[:, 0].transpose(1, 0, 2))
    return shown


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
