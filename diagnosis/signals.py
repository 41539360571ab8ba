"""The signals that a report draws: measured and simulated, around the largest residual."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from backends.state import Array
from diagnosis.evidence.evidence import Evidence
from diagnosis.models.world import World
from diagnosis.motion.recordings import CHANNELS

EXCERPT_S = 8.0
"""Length of what is kept [s]."""
DIGITS = 6
NOMINAL = "nominal"


@dataclass(frozen=True, kw_only=True)
class Signals:
    """One joint's readings on one channel of one episode, beside simulations."""

    joint: str
    channel: str
    """`position`, `motor` or `torque`."""
    protocol: str
    slides: bool
    """Whether positions are in m and torques in N, instead of rad and Nm."""
    time_s: tuple[float, ...]
    measured: tuple[float, ...]
    simulated: dict[str, tuple[float, ...]]
    """By name of the world; `nominal` first."""
    floor: float
    """The noise floor of the channel."""
    worst_s: float
    """When the nominal world is furthest off."""


def signals(
    evidence: Evidence, worlds: Mapping[str, tuple[World, Mapping[int, float]]], joint: int
) -> Signals:
    """The signals of one joint in the episode and channel where the nominal world is worst.

    `worlds`: by name, a world and its parameters; `nominal` among them.
    """
    limb, shown = evidence.limb, {name: world.blocks(u) for name, (world, u) in worlds.items()}
    left = (evidence.measured - shown[NOMINAL])[:, :, joint] / evidence.floor[:, joint]
    squares = [np.ma.masked_invalid(part**2) for part in limb.by_episode(left)]
    sizes = np.stack([one.mean(axis=0).filled(0.0) for one in squares])
    number, channel = map(int, np.unravel_index(int(np.argmax(sizes)), sizes.shape))
    time_s, measured = limb.time_s[number], limb.by_episode(evidence.measured)[number]
    worst_s = float(time_s[int(np.argmax(squares[number][:, channel].filled(0.0)))])
    begin_s = float(np.clip(worst_s - EXCERPT_S / 2, 0.0, max(time_s[-1] - EXCERPT_S, 0.0)))
    kept = (time_s >= begin_s) & (time_s <= begin_s + EXCERPT_S)
    kept &= np.isfinite(measured[:, channel, joint])

    def line(values: Array) -> tuple[float, ...]:
        own = limb.by_episode(values)[number][kept, channel, joint]
        return tuple(float(f"{v:.{DIGITS}g}") for v in own)

    return Signals(
        joint=evidence.joints[joint],
        channel=CHANNELS[channel],
        protocol=limb.recordings[number].protocol,
        slides=limb.spec.hand.driven[joint].joint.slides,
        time_s=tuple(float(f"{t:.{DIGITS}g}") for t in time_s[kept]),
        measured=line(evidence.measured),
        simulated=drawable({name: line(values) for name, values in shown.items()}),
        floor=float(evidence.floor[channel, joint]),
        worst_s=worst_s,
    )


def drawable(lines: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
    """The lines without those of worlds that diverge, of which nothing can be drawn or kept."""
    return {name: line for name, line in lines.items() if np.isfinite(line).all()}
