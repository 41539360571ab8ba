"""Worlds on the nominal engine, under a log's own commands.

A diagnosis replays worlds thousands of times, so it uses a compiled replay. This module checks that
replay against the engine in the nominal world, and what was found against the log.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.logs.log import Log
from diagnosis.motion.batch import Simulate, replay
from diagnosis.motion.columns import with_numbers
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import (
    CHANNELS,
    Recording,
    episodes_of,
    lasting,
    recording,
    recordings,
)
from diagnosis.replay.parts import limbs

HORIZON_S = 2.0
"""Duration of an episode that is compared [s]."""
RANDOM = (
    *("encoder.noise_rad", "encoder.resolution_rad", "command.loss_share", "command.jitter_s"),
    "drive.play_rad",
)
"""Numbers of what a replay leaves out or cannot follow."""


def apart_rad(simulate: Simulate, spec: Spec, log: Log) -> float:
    """Largest difference of a position at the beginning of free-air episodes [rad].

    Raises LogError if there is no such episode, ValueError if the engine refuses a number of the
    world.
    """
    spec = followed(spec)
    shown = replay(simulate, [spec], begun(log, spec))
    names = spec.hand.joint_names
    return max(
        apart(part, motion, engine[0, :, 0, [names.index(n) for n in part.hand.joint_names]].T)
        for part in limbs(spec)
        for motion, engine in zip(begun(log, part), shown, strict=True)
    )


def followed(spec: Spec) -> Spec:
    """A world without what a replay leaves out or cannot follow.

    Noise, encoder steps, lost and unpunctual targets, and play: rounding errors of a joint that
    rattles in it grow tenfold in a quarter of a second, in every simulation.
    """
    return with_numbers(spec, dict.fromkeys(spec.hand.joint_names, dict.fromkeys(RANDOM, 0.0)))


def begun(log: Log, spec: Spec) -> tuple[Recording, ...]:
    """The beginnings of a log's free-air episodes, under commands and pushes alone.

    Of open loops with the torques and speeds that are all that is asked. Without motor angles: all
    replays start with the motor at the joint's angle.
    """
    is_open = any(body.joint.loop.open for body in spec.hand.driven)
    more: dict[str, Any] = {} if is_open else {"speed": None, "torque": None}
    every = []
    for one in episodes_of(log, spec):
        time_s = log.episode(one.episode)["t_s"].to_numpy(float)
        rows = int(np.searchsorted(time_s, time_s[0] + HORIZON_S)) + 1
        part = recording(log, spec, one, slice(0, rows))
        part.measured[:, CHANNELS.index("motor")] = np.nan
        every.append(dataclasses.replace(part, sent_s=None, **more))
    return lasting(every)


def apart(part: Spec, motion: Recording, position: Array, rigid: bool = False) -> float:
    """How far a limb's positions (T, K) are at most from its replay about them [rad or m]."""
    measured = np.full((len(position), len(CHANNELS), position.shape[1]), np.nan)
    measured[:, 0] = position
    about = dataclasses.replace(motion, measured=measured, start=position[0])
    limb = Limb(spec=part, recordings=(about,), rigid=rigid)
    return float(
        np.abs(limb.simulate(limb.nominal, edges=limb.every_sample)[:, 0] - position).max()
    )


def engine_gaps_rad(simulate: Simulate, specs: Sequence[Spec], log: Log) -> tuple[float, ...]:
    """Root mean square distance of positions in free air from a log's, by world [rad].

    Raises ValueError if the engine refuses a number of a world.
    """
    motions = recordings(log, specs[0])
    shown = replay(simulate, specs, motions)
    off = [s[:, :, 0] - m.measured[:, 0] for s, m in zip(shown, motions, strict=True)]
    squares = np.concatenate([one.reshape(len(specs), -1) ** 2 for one in off], axis=1)
    return tuple(np.sqrt(np.nanmean(squares, axis=1)).tolist())
