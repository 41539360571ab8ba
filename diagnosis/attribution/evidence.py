"""Evidence: what a log says of one limb, and how far a candidate world is from it.

A limb is a part of the mechanism that moves by itself in free air, such as a finger. The distance
is a vector of residuals over their standard deviations, position, motor and torque alike.
"""

import dataclasses
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.logs.log import Log, LogError
from diagnosis.replay.replay import CHANNELS, Commands, limbs, replay

FREE_AIR = ("steps", "triangle", "multisine", "push", "free")
"""Protocols without a stick in the hand."""
USED = ("position", "motor", "torque")
"""Channels that are compared; velocity follows from position."""
LEAST_SAMPLES = 100
"""An episode shorter than this is left out."""
FAR = 1e4
"""Residuals end here: a candidate that is unstable is merely very bad."""
NUDGE_RAD = 1e-5
"""A shift of the start that no sensor shows [rad]."""
CORE = 3.0
"""Residuals under so many standard deviations count in full."""
REST_SAMPLES = 3
"""The start is the mean of so many readings at rest."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """One episode of one limb."""

    protocol: str
    commands: Commands
    measured: Array
    """Readings, shape (C, T, J) in the order of `USED`; NaN where none were logged."""
    judged: Array
    """Samples on which candidates are judged, the others are for fitting; shape (T,), bool."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """All usable episodes of one limb, and the nominal world."""

    nominal: Spec
    recordings: tuple[Recording, ...]
    sigma: Array
    """Standard deviation of a residual, noise and model floor, shape (C, 1, J)."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the limb's joints."""
        return self.nominal.hand.joint_names

    def world(self, effects: Sequence[Effect]) -> Spec:
        """The nominal world with effects."""
        spec = self.nominal
        for effect in effects:
            spec = effect.on_spec(spec)
        return spec

    def residual(
        self, effects: Sequence[Effect], judged: bool | None = None, compress: bool = True
    ) -> Array:
        """Normalised residuals, flat: of the samples for judging, for fitting, or all (None).

        Recordings follow each other, in each channels, samples and joints; what was not logged is
        left out. `compress` lets a residual grow as its logarithm beyond `CORE`: a joint rattling
        in its play is chaotic, and no candidate can follow it for long.
        """
        spec = self.world(effects)
        rows = [CHANNELS.index(name) for name in USED]
        parts = []
        for recording, mask in zip(self.recordings, self._masks[judged], strict=True):
            if mask.any():
                shown = replay(spec, recording.commands)[rows]
                parts.append(((recording.measured - shown) / self.sigma)[mask])
        flat = np.clip(np.nan_to_num(np.concatenate(parts), nan=FAR), -FAR, FAR)
        return CORE * np.arcsinh(flat / CORE) if compress else flat

    def unrest(self, effects: Sequence[Effect]) -> float:
        """How far a candidate strays from itself when it starts by `NUDGE_RAD` elsewhere.

        Root mean square on the samples for judging, compressed like residuals. Play rattles: from
        starts that no sensor tells apart, a joint takes other ways, so no world fits better.
        """
        spec = self.world(effects)
        rows = [CHANNELS.index(name) for name in USED]
        parts = []
        for recording, mask in zip(self.recordings, self._masks[True], strict=True):
            if mask.any():
                moved = dataclasses.replace(
                    recording.commands, start=recording.commands.start + NUDGE_RAD
                )
                ways = [replay(spec, c)[rows] for c in (recording.commands, moved)]
                parts.append(((ways[0] - ways[1]) / self.sigma)[mask])
        apart = CORE * np.arcsinh(np.concatenate(parts) / CORE)
        return float(np.sqrt(np.mean(np.nan_to_num(apart, nan=FAR) ** 2)))

    @cached_property
    def _masks(self) -> dict[bool | None, list[Array]]:
        logged = [np.isfinite(r.measured) for r in self.recordings]
        pairs = list(zip(logged, self.recordings, strict=True))
        split: dict[bool | None, list[Array]] = {
            wanted: [m & (r.judged == wanted)[None, :, None] for m, r in pairs]
            for wanted in (True, False)
        }
        return {None: logged, **split}


def gather(log: Log, nominal: Spec, floor: dict[str, float]) -> tuple[Evidence, ...]:
    """The evidence for every limb of the nominal world.

    `floor` is the model's own error per channel: radians, and of torques a share of the limit.
    Raises LogError where the log lacks a joint or has no usable episode.
    """
    missing = [name for name in nominal.hand.joint_names if name not in log.joints]
    if missing:
        raise LogError(f"this log has no commands for {', '.join(missing)}; record every joint")
    numbers = [
        e.episode
        for e in log.episodes
        if e.protocol in FREE_AIR and len(log.episode(e.episode)) >= LEAST_SAMPLES
    ]
    if not numbers:
        raise LogError(
            f"not identifiable from this log: no free-air episode of {LEAST_SAMPLES} samples or "
            f"more; record {', '.join(FREE_AIR[:4])}"
        )
    return tuple(_limb(log, part, numbers, floor) for part in limbs(nominal))


def _limb(log: Log, nominal: Spec, numbers: list[int], floor: dict[str, float]) -> Evidence:
    judged = _judged(log, numbers)
    recordings = tuple(_recording(log, nominal, number, judged[number]) for number in numbers)
    limit = np.array([drive.torque_limit_nm for drive in nominal.drives])
    allowed = np.array([[floor["position"]], [floor["motor"]], [floor["torque"]]])
    allowed = np.broadcast_to(allowed, (len(USED), len(limit))) * np.where(
        np.array([name == "torque" for name in USED])[:, None], limit, 1.0
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice")  # a channel that nobody logged
        noise = np.nanmedian([_noise(r.measured) for r in recordings], axis=0)
    sigma = np.sqrt(np.nan_to_num(noise) ** 2 + allowed**2)
    return Evidence(nominal=nominal, recordings=recordings, sigma=sigma[:, None, :])


def _recording(log: Log, nominal: Spec, number: int, judged: Array) -> Recording:
    names, frame = nominal.hand.joint_names, log.episode(number)

    def read(kind: str) -> Array:
        blank = np.full(len(frame), np.nan)
        columns = [log.column(kind, n) if log.has(kind, n) else None for n in names]
        return np.stack([blank if c is None else frame[c].to_numpy(float) for c in columns], axis=1)

    time_s = frame["t_s"].to_numpy(float)
    measured = np.stack([read(kind) for kind in USED])
    commands = Commands(
        ticks=np.round((time_s - time_s[0]) / nominal.timing.drive_s).astype(np.int64),
        target=read("command"),
        load=np.nan_to_num(read("push")),
        start=measured[0, :REST_SAMPLES].mean(axis=0),
    )
    protocol = next(e.protocol for e in log.episodes if e.episode == number)
    return Recording(protocol=protocol, commands=commands, measured=measured, judged=judged)


def _judged(log: Log, numbers: list[int]) -> dict[int, Array]:
    """Which samples judge: every second episode of a protocol, or the end of its only one."""
    seen: dict[str, int] = {}
    counts: dict[str, int] = {}
    protocol = {e.episode: e.protocol for e in log.episodes}
    for number in numbers:
        counts[protocol[number]] = counts.get(protocol[number], 0) + 1
    masks = {}
    for number in numbers:
        name, length = protocol[number], len(log.episode(number))
        seen[name] = seen.get(name, 0) + 1
        if counts[name] > 1:
            masks[number] = np.full(length, seen[name] % 2 == 0)
        else:
            masks[number] = np.arange(length) >= 0.6 * length
    return masks


def _noise(measured: Array) -> Array:
    """White noise of a recording (C, J): third differences take smooth motion away."""
    third = np.diff(measured, n=3, axis=1)
    return np.median(np.abs(third), axis=1) / 0.6745 / np.sqrt(20.0)
