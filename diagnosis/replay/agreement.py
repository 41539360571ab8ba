"""Compare the compiled replay of a world with an engine, on a log's own commands.

A diagnosis replays worlds thousands of times, so it uses a compiled replay. This module checks that
replay against the engine in the nominal world.
"""

import dataclasses

import numpy as np

from backends.spec import Body, Spec
from diagnosis.attribution.gather import FREE_AIR
from diagnosis.calibration import worlds
from diagnosis.calibration.worlds import Motion, Simulate
from diagnosis.logs.log import Log
from diagnosis.replay.replay import CHANNELS, Commands, limbs, replay

HORIZON_S = 2.0
"""Duration of an episode that is compared [s]. Rounding errors of a joint that rattles in its play
grow tenfold in a quarter of a second, in every simulation."""


def apart_rad(simulate: Simulate, spec: Spec, log: Log) -> float:
    """Largest difference of a position at the beginning of free-air episodes [rad].

    Random parts, which a replay leaves out, are switched off: noise, encoder steps, lost targets.
    Zero if there is no such episode. Raises ValueError if the engine refuses a number of the world.
    """
    spec = spec.with_driven(_sure(body) for body in spec.hand.driven)
    names, drive_s = spec.hand.joint_names, spec.timing.drive_s
    horizon = round(HORIZON_S / drive_s)
    motions = [_unread(m.first(horizon)) for m in worlds.motions(log, names, drive_s, FREE_AIR)]
    if not motions:
        return 0.0
    shown = worlds.replay(simulate, [spec], motions)
    apart = 0.0
    for limb in limbs(spec):
        columns = [names.index(name) for name in limb.hand.joint_names]
        for motion, engine in zip(motions, shown, strict=True):
            ours = replay(limb, _commands(motion, limb, columns))[CHANNELS.index("position")]
            apart = max(apart, float(np.abs(ours - engine[0, 0][:, columns]).max()))
    return apart


def _sure(body: Body) -> Body:
    encoder = dataclasses.replace(body.joint.encoder, noise_rad=0.0, resolution_rad=0.0)
    command = dataclasses.replace(body.joint.command, loss_share=0.0)
    joint = dataclasses.replace(body.joint, encoder=encoder, command=command)
    return dataclasses.replace(body, joint=joint)


def _unread(motion: Motion) -> Motion:
    """The motion without motor angles: both sides start with the motor at the joint's angle."""
    read_rad = motion.read_rad.copy()
    read_rad[worlds.READINGS.index("motor")] = np.nan
    return dataclasses.replace(motion, read_rad=read_rad)


def _commands(motion: Motion, limb: Spec, columns: list[int]) -> Commands:
    """The motion as a replay takes it: an engine starts at angles, a replay at readings."""
    encoders = [body.joint.encoder for body in limb.hand.driven]
    start_rad = motion.read_rad[0, : worlds.REST_SAMPLES][:, columns].mean(axis=0)
    reading = np.array([e.bias_rad for e in encoders])
    reading = reading + start_rad * np.array([1.0 + e.scale_error for e in encoders])
    return Commands(
        ticks=motion.tick,
        target=motion.command_rad[:, columns],
        load=motion.push_nm[:, columns],
        start=reading,
    )
