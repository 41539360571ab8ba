"""Where the gap lies: squared residuals by joint, channel, protocol and phase of the motion."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd

from backends.state import Array
from diagnosis.attribution.evidence import USED, Evidence, Recording
from diagnosis.replay.replay import CHANNELS, replay

PHASES = ("external load", "hold", "reversal", "constant speed", "acceleration")
SLOW, STEADY = 0.03, 0.15
"""A joint holds under this share of its fastest speed; speed is constant under this share of the
largest acceleration."""
REVERSAL_S = 0.06
"""A reversal lasts so long to either side of standstill."""
BLOCK_S = 0.25
"""Samples within this time are resampled together."""
RESAMPLES = 200
EPISODES, BLOCKS = 1 << 20, 1 << 20
"""More episodes of a setting, and blocks of an episode, than any log has: they number blocks."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """One part of the gap."""

    joint: str
    channel: str
    protocol: str
    phase: str
    share: float
    """Share of the whole squared gap, in units of the noise."""
    share_interval: tuple[float, float]
    """90 % interval of the share, from blocks of samples."""
    rms: float
    """Root mean square of the residual [rad or Nm]."""
    noise: float
    """The floor it stands beside: noise and the model's own error [rad or Nm]."""
    samples: int

    def row(self) -> dict:
        """As plain data."""
        return {**asdict(self), "share_interval": list(self.share_interval)}


def locate(parts: Sequence[Evidence], seed: int = 0) -> list[Place]:
    """The gap between log and nominal world over all limbs, largest part first."""
    settings = [pair for evidence in parts for pair in enumerate(evidence.settings)]
    names = {
        "joint": list(dict.fromkeys(j for part in parts for j in part.joints)),
        "channel": list(USED),
        "protocol": sorted({r.protocol for _, one in settings for r in one.recordings}),
        "phase": list(PHASES),
    }
    table = pd.concat([_table(*pair, names) for pair in settings], ignore_index=True)
    table["square"] = (table["residual"] / table["noise"]) ** 2
    table["power"] = table["residual"] ** 2
    keys = list(names)
    found = table.groupby(keys).agg(
        share=("square", "sum"),
        power=("power", "mean"),
        noise=("noise", "first"),
        samples=("residual", "size"),
    )
    found["share"] /= max(float(found["share"].sum()), 1e-300)
    by_block = table.pivot_table("square", "block", keys, "sum", 0.0)
    low, high = _interval(by_block[list(found.index)].to_numpy(), np.random.default_rng(seed))
    places = [
        Place(
            **{key: names[key][code] for key, code in zip(keys, index, strict=True)},
            share=float(row["share"]),
            share_interval=(float(low[k]), float(high[k])),
            rms=float(np.sqrt(row["power"])),
            noise=float(row["noise"]),
            samples=int(row["samples"]),
        )
        for k, (index, row) in enumerate(found.iterrows())
    ]
    return sorted(places, key=lambda place: -place.share)


def _interval(by_block: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """90 % intervals of each cell's share of the sum, from resampled blocks (B, cells)."""
    count = len(by_block)
    weights = rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    sums = weights @ by_block
    whole = np.maximum(sums.sum(axis=1, keepdims=True), 1e-300)
    low, high = np.percentile(sums / whole, [5, 95], axis=0)
    return low, high


def _table(setting: int, evidence: Evidence, names: Mapping[str, Sequence[str]]) -> pd.DataFrame:
    """A row per residual of one limb under one setting; what it is of as numbers of `names`."""
    rows = [CHANNELS.index(name) for name in USED]
    joint = [names["joint"].index(name) for name in evidence.joints]
    frames = []
    for number, recording in enumerate(evidence.recordings):
        shown = replay(evidence.nominal, recording.commands)
        residual = recording.measured - shown[rows]
        time_s = recording.commands.ticks * evidence.nominal.timing.drive_s
        block = (time_s / BLOCK_S).astype(int) + (setting * EPISODES + number) * BLOCKS
        columns = {
            "joint": np.array(joint),
            "channel": np.arange(len(USED))[:, None, None],
            "protocol": np.array(names["protocol"].index(recording.protocol)),
            "phase": phases(evidence, recording, shown),
            "block": block[:, None],
            "residual": residual,
            "noise": evidence.sigma,
        }
        logged = np.isfinite(residual)
        same = {key: np.broadcast_to(v, residual.shape)[logged] for key, v in columns.items()}
        frames.append(pd.DataFrame(same))
    return pd.concat(frames, ignore_index=True)


def phases(evidence: Evidence, recording: Recording, shown: Array) -> Array:
    """What each joint is doing at each sample by the nominal world: index of PHASES, (T, J)."""
    time_s = recording.commands.ticks * evidence.nominal.timing.drive_s
    speed = shown[CHANNELS.index("velocity")]
    acceleration = np.gradient(speed, time_s, axis=0)
    fastest = np.maximum(np.abs(speed).max(axis=0), 1e-9)
    strongest = np.maximum(np.abs(acceleration).max(axis=0), 1e-9)
    phase = np.full(speed.shape, PHASES.index("acceleration"))
    phase[np.abs(acceleration) < STEADY * strongest] = PHASES.index("constant speed")
    turns = np.diff(np.sign(speed), axis=0, prepend=np.sign(speed[:1])) != 0
    moving = np.abs(acceleration) > STEADY * strongest
    reach = max(1, round(REVERSAL_S / float(np.median(np.diff(time_s)))))
    near = np.stack([np.convolve(t, np.ones(2 * reach + 1), "same") for t in turns.T], axis=1) > 0
    phase[near & moving] = PHASES.index("reversal")
    phase[(np.abs(speed) < SLOW * fastest) & ~near] = PHASES.index("hold")
    phase[recording.commands.load != 0] = PHASES.index("external load")
    return phase
