"""Where the gap lies: squared residuals by joint, channel, protocol and phase of the motion."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation

from backends.state import Array
from diagnosis.models.world import World
from diagnosis.motion.recordings import CHANNELS

DURING = {
    "external load": "under external load",
    "hold": "in holds",
    "reversal": "at reversals",
    "constant speed": "at constant speed",
    "acceleration": "in acceleration",
}
"""Phases of a joint's motion, as named and as said."""
PHASES = tuple(DURING)
SLOW, STEADY = 0.03, 0.15
"""A joint holds under this share of its fastest speed; speed is constant under this share of the
largest acceleration."""
REVERSAL_S = 0.06
"""A reversal lasts so long to either side of standstill."""
RESAMPLES = 200
KEYS = ["joint", "channel", "protocol", "phase"]


@dataclass(frozen=True, kw_only=True)
class Place:
    """One part of the gap."""

    joint: str
    channel: str
    protocol: str
    phase: str
    share: float
    """Share of the whole squared gap, in floors."""
    share_interval: tuple[float, float]
    """90 % interval of the share, from resampled seconds."""
    rms: float
    """Root mean square of the residual [rad or Nm; m or N of a slide]."""
    noise: float
    """The floor that it stands beside, in the same unit."""
    samples: int


def locate(limbs: Sequence[World]) -> list[Place]:
    """The gap between a log and the nominal worlds of its limbs, largest part first."""
    table = pd.concat([_table(*one) for one in enumerate(limbs)], ignore_index=True)
    table["square"] = (table["residual"] / table["noise"]) ** 2
    found = table.groupby(KEYS).agg(
        share=("square", "sum"),
        rms=("residual", lambda left: float(np.sqrt(np.mean(left**2)))),
        noise=("noise", "first"),
        samples=("residual", "size"),
    )
    found["share"] /= max(float(found["share"].sum()), 1e-300)
    by_second = table.pivot_table("square", ["limb", "second"], KEYS, "sum", 0.0)
    ends = _interval(by_second[list(found.index)].to_numpy(), np.random.default_rng(0))
    found["share_interval"] = list(map(tuple, np.transpose(ends).tolist()))
    rows = found.sort_values("share", ascending=False, kind="stable").reset_index()
    return [Place(**row) for row in rows.to_dict("records")]


def largest(places: Sequence[Place], joints: Sequence[str]) -> str:
    """At which of some joints, and in which phase of its motion, most of their gap lies."""
    shares = defaultdict[tuple[str, str], float](float)
    for place in places:
        if place.joint in joints:
            shares[place.joint, place.phase] += place.share
    joint, phase = max(shares, key=shares.__getitem__)
    part = 100 * shares[joint, phase] / max(sum(shares.values()), 1e-300)
    return f"The largest part of the gap, {part:.0f} %, lies {DURING[phase]} of {joint}."


def _interval(by_second: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """90 % intervals of each cell's share of the sum, from resampled seconds (S, cells)."""
    count = len(by_second)
    weights = rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    sums = weights @ by_second
    whole = np.maximum(sums.sum(axis=1, keepdims=True), 1e-300)
    low, high = np.percentile(sums / whole, [5, 95], axis=0)
    return low, high


def _table(number: int, world: World) -> pd.DataFrame:
    """A row per residual of the nominal world of a limb."""
    evidence, shown = world.evidence, world.blocks({})
    limb = evidence.limb
    angles = limb.by_episode(np.nan_to_num(shown[:, 0]))
    pushed = limb.by_episode(limb.means(lambda one: np.abs(one.push)) > 0.0)
    phase = np.concatenate(list(map(phases, limb.time_s, angles, pushed)))
    protocol = np.repeat([r.protocol for r in limb.recordings], list(map(len, limb.time_s)))
    j, c, n = np.nonzero(evidence.logged & np.isfinite(shown).transpose(2, 1, 0))
    return pd.DataFrame(
        {
            "limb": number,
            "second": evidence.second[n],
            "joint": np.array(evidence.joints)[j],
            "channel": np.array(CHANNELS)[c],
            "protocol": protocol[n],
            "phase": phase[n, j],
            "residual": (evidence.measured - shown)[n, c, j],
            "noise": evidence.floor[c, j],
        }
    )


def phases(time_s: Array, angle: Array, pushed: Array) -> Array:
    """Names of phases (T, K) from the angles of a motion (T, K) and where joints are pushed."""
    if len(time_s) < 3:
        return np.full(angle.shape, "hold")
    speed = np.gradient(angle, time_s, axis=0)
    acceleration = np.gradient(speed, time_s, axis=0)
    fastest = np.maximum(np.abs(speed).max(axis=0), 1e-9)
    strongest = np.maximum(np.abs(acceleration).max(axis=0), 1e-9)
    turns = np.diff(np.sign(speed), axis=0, prepend=np.sign(speed[:1])) != 0
    reach = max(1, round(REVERSAL_S / float(np.median(np.diff(time_s)))))
    near = binary_dilation(turns, np.ones((2 * reach + 1, 1)))
    still = (np.abs(speed) < SLOW * fastest) & ~near
    steady = np.abs(acceleration) < STEADY * strongest
    every = {"external load": pushed, "hold": still, "constant speed": steady, "reversal": near}
    return np.select(list(every.values()), list(every), "acceleration")
