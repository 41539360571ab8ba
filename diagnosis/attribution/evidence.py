"""Evidence: what a log says of one limb, and how far a candidate world is from it.

A limb is a part of the mechanism that moves by itself in free air, such as a finger. The distance
is a vector of residuals over their standard deviations, position, motor and torque alike.
"""

import dataclasses
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.polynomial.hermite_e import hermegauss

from backends.effect import Effect
from backends.spec import Spec
from backends.state import Array
from diagnosis.attribution.replayed import Replayed
from diagnosis.attribution.sound import Sound
from diagnosis.attribution.timing import late_s, residual, sensors
from diagnosis.attribution.whiten import FAR, ROUGH, innovations, news
from diagnosis.replay.limb import CHANNELS
from diagnosis.replay.replay import Commands

USED = CHANNELS[:3]
"""Channels that are compared; velocity follows from position."""
NUDGE_RAD = 1e-5
"""A shift of the start that no sensor shows [rad]."""
CORE = 3.0
"""Residuals under so many standard deviations count in full."""
_NODES = 20
"""Of a quadrature."""


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
class Trace:
    """What a world shows in one recording at the samples that are compared, and what it leaves."""

    shown: Array
    """Position, motor angle, torque and speed, shape (4, T, J)."""
    faster: Array
    """Acceleration [rad/s2], shape (T, J)."""
    load: Array
    """External torque [Nm], shape (T, J)."""
    left: Array
    """Residuals, shape (C, T, J); NaN where none were logged."""
    weight: Array
    """Factor by which they are weighted already for the prediction spread, shape (C, T, J)."""
    judged: Array
    """Samples on which candidates are judged, shape (T,), bool."""


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
    """Every n-th sample is compared, n being this."""
    astray: tuple[Array, ...] = ()
    """How far a joint in its play may be from any replay, in `sigma`: per recording (C, T, J)."""
    sound: Sound | None = None
    """What logs of the same mechanism leave while nothing is wrong; None: there are none."""

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

    def knowing(self, effects: Sequence[Effect]) -> "Evidence":
        """The evidence against a nominal world with effects."""
        return dataclasses.replace(self, nominal=self.world(effects))

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
        """The innovations of each residual, see `whiten`: white where the candidate is right.

        In the order of `residual`.
        """
        flat, noise = np.empty(sum(self._counts[judged])), (self._white, self.floor[:, 0])
        ends = np.cumsum(self._counts[judged])
        rows = zip(self._left(effects, judged), self._compared[judged], ends, strict=True)
        for left, mask, end in rows:
            news(left, *noise, self.sample_s, mask, flat[:end])
        return compressed(flat) if compress else flat

    def tracks(self, judged: bool | None = None) -> Array:
        """Which channel and joint each residual is of, as a number, in the order of `residual`."""
        number = np.arange(self.sigma.size, dtype=float).reshape(self.sigma.shape).swapaxes(1, 2)
        parts = [np.broadcast_to(number, mask.shape) for mask in self._compared[judged]]
        return self._flat([part.swapaxes(1, 2) for part in parts], judged)

    def protocols(self, judged: bool | None = None) -> Array:
        """Which protocol each residual is of, by name, in the order of `residual`."""
        ends = self._ends[judged]
        names = [r.protocol for r, end in zip(self.recordings, ends, strict=True) if end]
        return np.repeat(np.array(names), self._counts[judged])

    def whitened(self, left: Array) -> Array:
        """Innovations of residuals (C, T, J) of samples that are compared."""
        return innovations(left, self._white, self.floor[:, 0], self.sample_s)

    @cached_property
    def _white(self) -> Array:
        """Standard deviation of the white part of a residual, shape (C, J)."""
        rough = (ROUGH * self.floor) ** 2
        return np.sqrt(np.maximum(self.sigma**2 - self.floor**2, rough))[:, 0]

    @cached_property
    def quiet(self) -> float:
        """The gap that noise alone would leave on the samples for judging.

        Root mean square of compressed normal variables, by Gauss-Hermite quadrature.
        """
        nodes, weights = hermegauss(_NODES)
        share = (self._white / self.sigma[:, 0]).ravel()[:, None]
        squares = compressed(share * nodes) ** 2 @ weights / weights.sum()
        tracks = self.tracks(True).astype(np.int64)
        return float(np.sqrt(squares[tracks].mean())) if len(tracks) else 0.0

    def allowing_for(self, effects: Sequence[Effect]) -> "Evidence":
        """The evidence with white errors as large as what a candidate leaves, where that is more.

        An explanation of a real log leaves more than a floor allows, and what is slow in it is not
        known: least squares are then less biased.
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

    def filtered(self, signals: Array, channel: int, joint: int) -> Array:
        """Signals (K, T) of samples that are compared, as `whitened` filters one residual."""
        noise = (s[channel, joint] for s in (self._white, self.floor[:, 0]))
        white, slow = (np.full((len(signals), 1), one) for one in noise)
        return innovations(signals[:, :, None], white, slow, self.sample_s)[:, :, 0]

    def traces(self, effects: Sequence[Effect]) -> Iterator[Trace]:
        """Every recording as the world with effects replays it."""
        every = slice(None, None, self.stride)
        shown = self._replayed.shown(effects, self._ends[None])
        kept = [r for r, end in zip(self.recordings, self._ends[None], strict=True) if end]
        astray = self.astray or [np.zeros_like(r.measured[:, every]) for r in self.recordings]
        far = [one for one, end in zip(astray, self._ends[None], strict=True) if end]
        rows = zip(kept, shown, self._left(effects, None), far, strict=True)
        for recording, moved, left, apart in rows:
            count, some = moved.shape[1], moved[:, every]
            time_s = recording.commands.ticks[:count][every] * self.nominal.timing.drive_s
            yield Trace(
                shown=some,
                faster=np.gradient(some[3], time_s, axis=0),
                load=recording.commands.load[:count][every],
                left=left,
                weight=1 / np.hypot(1.0, apart[:, : left.shape[1]]),
                judged=recording.judged[:count][every],
            )

    def _left(self, effects: Sequence[Effect], judged: bool | None) -> list[Array]:
        """Residuals (C, T, J) of every recording that has samples of the kind, up to the last."""
        shift_s, at = late_s(effects), sensors(self.world(effects))
        asked = self._asked[judged]
        shown = self._replayed.shown(effects, self._ends[judged])
        left = []
        for (time_s, measured), wild in zip(asked, shown, strict=True):
            left.append(residual(measured, wild, time_s, at, shift_s, self.stride))
        if not self.astray:
            return left
        ends = self._ends[judged]
        far = [one for one, end in zip(self._spread, ends, strict=True) if end]
        return [one / apart[:, : one.shape[1]] for one, apart in zip(left, far, strict=True)]

    @cached_property
    def _spread(self) -> list[Array]:
        """What residuals are divided by where joints are astray, per recording (C, T, J)."""
        return [np.hypot(1.0, apart) for apart in self.astray]

    @cached_property
    def _replayed(self) -> Replayed:
        return Replayed(self.nominal, [r.commands for r in self.recordings])

    @cached_property
    def _asked(self) -> dict[bool | None, list[tuple[Array, Array]]]:
        """Times [s] and readings of each recording up to the last sample that is compared."""
        drive_s = self.nominal.timing.drive_s
        return {
            wanted: [
                (r.commands.ticks[:end] * drive_s, np.ascontiguousarray(r.measured[:, :end]))
                for r, end in zip(self.recordings, ends, strict=True)
                if end
            ]
            for wanted, ends in self._ends.items()
        }

    def _flat(self, parts: Sequence[Array], judged: bool | None) -> Array:
        pairs = zip(parts, self._compared[judged], strict=True)
        flat = np.concatenate([part.swapaxes(1, 2)[mask] for part, mask in pairs])
        flat[np.isnan(flat)] = FAR
        return np.clip(flat, -FAR, FAR, out=flat)

    def unrest(self, effects: Sequence[Effect], moved: Sequence[Effect]) -> float:
        """How chaotic a candidate is: its distance from itself as `moved` and nudged at the start.

        Root mean square on the samples for judging, compressed like residuals. Play rattles: from
        starts that no sensor tells apart, a joint takes other ways, so no world fits better.
        """
        here = self._flat([left / self.sigma for left in self._left(effects, True)], True)
        other = self._elsewhere()
        there = other._flat([left / self.sigma for left in other._left(moved, True)], True)
        return float(np.sqrt(np.mean(compressed(here - there) ** 2)))

    def forgiving(self, effects: Sequence[Effect], moved: Sequence[Sequence[Effect]]) -> "Evidence":
        """The evidence with residuals counted in the prediction spread, where that is more.

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
    def _compared(self) -> dict[bool | None, list[Array]]:
        """Which samples (C, J, T) of each recording that has any are compared, up to the last."""
        return {
            wanted: [
                mask[:, : -(-end // self.stride)].swapaxes(1, 2)
                for mask, end in zip(masks, self._ends[wanted], strict=True)
                if end
            ]
            for wanted, masks in self._masks.items()
        }

    @cached_property
    def _counts(self) -> dict[bool | None, list[int]]:
        """Residuals of each recording that has any."""
        return {w: [int(mask.sum()) for mask in masks] for w, masks in self._compared.items()}

    @cached_property
    def _ends(self) -> dict[bool | None, list[int]]:
        """Samples of each recording up to the last that is compared."""

        def end(mask: Array) -> int:
            rows = np.flatnonzero(mask.any(axis=(0, 2)))
            return int(rows[-1]) * self.stride + 1 if len(rows) else 0

        return {wanted: [end(m) for m in masks] for wanted, masks in self._masks.items()}


def compressed(flat: Array | float) -> Array:
    """Residuals that grow as their logarithm beyond `CORE`."""
    return _compressed(np.asarray(flat))


@numba.vectorize(cache=True)
def _compressed(one):
    """CORE arsinh(one / CORE), by a logarithm: NumPy's takes twice as long."""
    size = abs(one) / CORE
    return math.copysign(CORE * math.log(size + math.sqrt(size * size + 1.0)), one)
