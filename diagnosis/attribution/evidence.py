"""Evidence: what a log says of one limb, and how far a candidate world is from it.

A limb is a part of the mechanism that moves by itself in free air, such as a finger. The distance
is a vector of residuals over their standard deviations, position, motor and torque alike.
"""

import dataclasses
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.replayed import Replayed
from diagnosis.attribution.timing import late_s, rates
from diagnosis.attribution.whiten import ROUGH, innovations
from diagnosis.logs.log import Log, LogError
from diagnosis.replay.limb import CHANNELS
from diagnosis.replay.replay import Commands, limbs

FREE_AIR = ("steps", "triangle", "multisine", "push", "free")
"""Protocols without a stick in the hand."""
USED = CHANNELS[:3]
"""Channels that are compared; velocity follows from position."""
LEAST_SAMPLES = 100
"""An episode shorter than this is left out."""
FAR = 1e4
"""Residuals end here: a candidate that is unstable is merely very bad."""
NUDGE_RAD = 1e-5
"""A shift of the start that no sensor shows [rad]."""
RATE_HZ = 200.0
"""Faster logs are compared this often: joints do nothing quicker."""
CORE = 3.0
"""Residuals under so many standard deviations count in full."""
_LOST = 1e6
"""What an unstable world shows [rad or Nm]."""
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
    floor: Array
    """Standard deviation of the model's own error in it, shape (C, 1, J)."""
    size: Array
    """What counts as a radian on each joint, shape (J,): 1, or on a slide how far it moved [m]."""
    stride: int = 1
    """Every so-manieth sample is compared."""
    astray: tuple[Array, ...] = ()
    """How far a joint in its play may be from any replay, in `sigma`: per recording (C, T, J)."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the limb's joints."""
        return self.nominal.hand.joint_names

    @property
    def settings(self) -> tuple["Evidence", ...]:
        """The evidence by settings of the mechanism, each with its own nominal world: one."""
        return (self,)

    def world(self, effects: Sequence[Effect]) -> Spec:
        """The nominal world with effects."""
        return self._replayed.world(effects)

    def residual(
        self, effects: Sequence[Effect], judged: bool | None = None, compress: bool = True
    ) -> Array:
        """Normalised residuals, flat: of the samples for judging, for fitting, or all (None).

        Recordings follow each other, in each channels, joints and samples; what was not logged is
        left out. `compress` lets a residual grow as its logarithm beyond `CORE`: a joint rattling
        in its play is chaotic, and no candidate can follow it for long.
        """
        flat = self._flat([left / self.sigma for left in self._left(effects, judged)], judged)
        return compressed(flat) if compress else flat

    def innovations(
        self, effects: Sequence[Effect], judged: bool | None = None, compress: bool = True
    ) -> Array:
        """What is new in each residual, see `whiten`: white where the candidate is right.

        In the order of `residual`.
        """
        parts = [self.whitened(left) for left in self._left(effects, judged)]
        flat = self._flat(parts, judged)
        return compressed(flat) if compress else flat

    def tracks(self, judged: bool | None = None) -> Array:
        """Which channel and joint each residual is of, as a number, in the order of `residual`."""
        masks = [m for m, end in zip(self._masks[judged], self._ends[judged], strict=True) if end]
        number = np.arange(self.sigma.size, dtype=float).reshape(self.sigma.shape)
        return self._flat([np.broadcast_to(number, m.shape) for m in masks], judged)

    def whitened(self, left: Array) -> Array:
        """What is new in residuals (C, T, J) of samples that are compared."""
        return innovations(left, self._white, self.floor[:, 0], self.sample_s)

    @cached_property
    def _white(self) -> Array:
        """Standard deviation of the white part of a residual, shape (C, J)."""
        rough = (ROUGH * self.floor) ** 2
        return np.sqrt(np.maximum(self.sigma**2 - self.floor**2, rough))[:, 0]

    def allowing_for(self, effects: Sequence[Effect]) -> "Evidence":
        """The evidence with white errors as large as what a candidate leaves, where that is more.

        An explanation of a real log leaves more than a floor allows, and what is slow in it is not
        known: least squares as they are then go less astray.
        """
        left = np.concatenate(self._left(effects, None), axis=1)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Mean of empty slice")  # nobody logged it
            rms = np.sqrt(np.nan_to_num(np.nanmean(left**2, axis=1)))
        sigma = np.maximum(self.sigma, rms[:, None])
        return dataclasses.replace(self, sigma=sigma, floor=0.0 * self.floor)

    @cached_property
    def sample_s(self) -> float:
        """Time between samples that are compared [s]."""
        ticks = [np.median(np.diff(r.commands.ticks)) for r in self.recordings]
        return float(np.median(ticks)) * self.stride * self.nominal.timing.drive_s

    def _left(self, effects: Sequence[Effect], judged: bool | None) -> list[Array]:
        """Residuals (C, T, J) of every recording that has samples of the kind, up to the last."""
        shift_s, world = late_s(effects), self.world(effects)
        asked = self._asked[judged]
        shown = self._replayed.shown(effects, self._ends[judged])
        left = []
        for (time_s, measured), wild in zip(asked, shown, strict=True):
            every = np.clip(wild, -_LOST, _LOST)
            moved = every[: len(USED)]
            if shift_s.any():
                moved = moved - shift_s[:, None, None] * rates(every, time_s, world)
            left.append((measured - moved)[:, :: self.stride])
        if not self.astray:
            return left
        ends = self._ends[judged]
        far = [one for one, end in zip(self.astray, ends, strict=True) if end]
        return [
            one / np.hypot(1.0, apart[:, : one.shape[1]])
            for one, apart in zip(left, far, strict=True)
        ]

    @cached_property
    def _replayed(self) -> Replayed:
        return Replayed(self.nominal, [r.commands for r in self.recordings])

    @cached_property
    def _asked(self) -> dict[bool | None, list[tuple[Array, Array]]]:
        """Times [s] and readings of each recording up to the last sample that is compared."""
        drive_s = self.nominal.timing.drive_s
        return {
            wanted: [
                (r.commands.ticks[:end] * drive_s, r.measured[:, :end])
                for r, end in zip(self.recordings, ends, strict=True)
                if end
            ]
            for wanted, ends in self._ends.items()
        }

    def _flat(self, parts: Sequence[Array], judged: bool | None) -> Array:
        masks = [m for m, end in zip(self._masks[judged], self._ends[judged], strict=True) if end]
        pairs = zip(parts, masks, strict=True)
        flat = [p.swapaxes(1, 2)[m[:, : p.shape[1]].swapaxes(1, 2)] for p, m in pairs]
        return np.clip(np.nan_to_num(np.concatenate(flat), nan=FAR), -FAR, FAR)

    def unrest(self, effects: Sequence[Effect], moved: Sequence[Effect]) -> float:
        """How far a candidate strays from itself as `moved`, and started by `NUDGE_RAD` elsewhere.

        Root mean square on the samples for judging, compressed like residuals. Play rattles: from
        starts that no sensor tells apart, a joint takes other ways, so no world fits better.
        """
        here = self._flat([left / self.sigma for left in self._left(effects, True)], True)
        other = self._elsewhere()
        there = other._flat([left / self.sigma for left in other._left(moved, True)], True)
        return float(np.sqrt(np.mean(compressed(here - there) ** 2)))

    def forgiving(self, effects: Sequence[Effect], moved: Sequence[Sequence[Effect]]) -> "Evidence":
        """The evidence with residuals counted in what a candidate cannot foretell, where more.

        A joint in its play goes its own way after the smallest change, so replays of the candidate
        as each of `moved`, nudged at the start, are spread at every sample as the truth is around
        any of them. All candidates are then compared with the same weights.
        """
        plain = dataclasses.replace(self, astray=())
        base = plain._left(effects, None)
        squares = [np.zeros_like(left) for left in base]
        for times, one in zip(np.linspace(-1, 1, len(moved)), moved, strict=True):
            elsewhere = plain._elsewhere(times)._left(one, None)
            for total, here, there in zip(squares, base, elsewhere, strict=True):
                total += np.nan_to_num((there - here) / self.sigma) ** 2 / len(moved)
        return dataclasses.replace(self, astray=tuple(np.sqrt(total) for total in squares))

    def _elsewhere(self, times: float = 1.0) -> "Evidence":
        return dataclasses.replace(self, recordings=tuple(self._nudged(times)))

    def _nudged(self, times: float) -> Iterator[Recording]:
        for recording in self.recordings:
            start = recording.commands.start + times * NUDGE_RAD * self.size
            commands = dataclasses.replace(recording.commands, start=start)
            yield dataclasses.replace(recording, commands=commands)

    @cached_property
    def _masks(self) -> dict[bool | None, list[Array]]:
        logged = [np.isfinite(r.measured)[:, :: self.stride] for r in self.recordings]
        pairs = list(zip(logged, self.recordings, strict=True))
        split: dict[bool | None, list[Array]] = {
            wanted: [m & (r.judged[:: self.stride] == wanted)[None, :, None] for m, r in pairs]
            for wanted in (True, False)
        }
        return {None: logged, **split}

    @cached_property
    def _ends(self) -> dict[bool | None, list[int]]:
        """Samples of each recording up to the last that is compared."""

        def end(mask: Array) -> int:
            rows = np.flatnonzero(mask.any(axis=(0, 2)))
            return int(rows[-1]) * self.stride + 1 if len(rows) else 0

        return {wanted: [end(m) for m in masks] for wanted, masks in self._masks.items()}


def compressed(flat: Array) -> Array:
    """Residuals that grow as their logarithm beyond `CORE`."""
    return CORE * np.arcsinh(flat / CORE)


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
    size = _sizes(nominal, recordings)
    limit = np.array([drive.torque_limit_nm for drive in nominal.drives])
    allowed = np.stack([floor[name] * (limit if name == "torque" else size) for name in USED])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice")  # a channel that nobody logged
        noise = np.nanmedian([_noise(r.measured) for r in recordings], axis=0)
    sigma = np.sqrt(np.nan_to_num(noise) ** 2 + allowed**2)
    period = np.median(np.diff(recordings[0].commands.ticks)) * nominal.timing.drive_s
    return Evidence(
        nominal=nominal,
        recordings=recordings,
        sigma=sigma[:, None, :],
        floor=allowed[:, None, :],
        size=size,
        stride=max(1, round(1 / (RATE_HZ * period))),
    )


def _sizes(nominal: Spec, recordings: Sequence[Recording]) -> Array:
    """See `Evidence.size`."""
    position = np.concatenate([r.measured[0] for r in recordings])
    moved = np.maximum(np.nanmax(position, axis=0) - np.nanmin(position, axis=0), 1e-9)
    slides = [body.joint.slides for body in nominal.hand.driven]
    return np.where(slides, moved, 1.0)


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
