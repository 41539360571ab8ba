"""One joint of a log and the same joint of the nominal world under its commands, for the triage."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from backends.state import Array
from diagnosis.attribution.evidence import USED, Evidence
from diagnosis.replay.replay import CHANNELS
from diagnosis.replay.replay import replay as _replay

STILL = 1e-6
"""Share of a motion's size below which a signal counts as still."""


@dataclass(frozen=True, kw_only=True)
class Track:
    """A joint over all episodes of its limb; lists hold an array (T,) per episode."""

    limb: Evidence
    index: int
    """Column of the joint in its limb."""
    time_s: list[Array]
    command: list[Array]
    position: list[Array]
    shown: list[Array]
    """Readings of the position sensor in the nominal world."""

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.limb.joints[self.index]

    @property
    def slides(self) -> bool:
        """Whether it is a slide."""
        return self.limb.nominal.hand.driven[self.index].joint.slides

    @property
    def dt_s(self) -> float:
        """Sample period [s], the median over all episodes."""
        return float(np.median(np.concatenate([np.diff(t) for t in self.time_s])))

    @property
    def travel(self) -> float:
        """Largest range of the commands in one episode [rad or m]."""
        return max(float(np.ptp(c)) for c in self.command)

    @property
    def misfit(self) -> float:
        """Distance of the positions from the nominal world's, over the size of the motion."""
        moved = np.concatenate(list(centred(self.command)))
        missed = np.concatenate(self.position) - np.concatenate(self.shown)
        found = float(np.sqrt(np.mean(missed**2) / max(np.mean(moved**2), 1e-18)))
        return found if np.isfinite(found) else np.inf

    def measured(self, channel: str) -> list[Array]:
        """Readings of a channel per episode; NaN where none were logged."""
        row = USED.index(channel)
        return [r.measured[row, :, self.index] for r in self.limb.recordings]

    def replayed(self, *, started: float = 0.0, paced: float = 1.0, pushed: float = 1.0) -> "Track":
        """The same track with another replay: start shifted, or time or pushes scaled."""
        return replace(self, shown=self.shown_of("position", started, paced, pushed))

    def shown_of(
        self, channel: str, started: float = 0.0, paced: float = 1.0, pushed: float = 1.0
    ) -> list[Array]:
        """A channel of the nominal world per episode, see `replayed`."""
        found = []
        for recording in self.limb.recordings:
            asked = recording.commands
            start, load = asked.start.copy(), asked.load.copy()
            start[self.index] += started
            load[:, self.index] *= pushed
            ticks = np.round(asked.ticks * paced).astype(np.int64)
            changed = replace(asked, ticks=ticks, start=start, load=load)
            row = _replay(self.limb.nominal, changed)[CHANNELS.index(channel)]
            found.append(row[:, self.index])
        return found


def tracks(limbs: Sequence[Evidence]) -> list[Track]:
    """The joints of all limbs; each limb is replayed once."""
    return [track for limb in limbs for track in _of_limb(limb)]


def _of_limb(limb: Evidence) -> Iterator[Track]:
    shown = [_replay(limb.nominal, r.commands)[0] for r in limb.recordings]
    period_s = limb.nominal.timing.drive_s
    for j in range(len(limb.joints)):
        yield Track(
            limb=limb,
            index=j,
            time_s=[r.commands.ticks * period_s for r in limb.recordings],
            command=[r.commands.target[:, j] for r in limb.recordings],
            position=[r.measured[0, :, j] for r in limb.recordings],
            shown=[s[:, j] for s in shown],
        )


def centred(episodes: Sequence[Array]) -> Iterator[Array]:
    """Every episode minus its mean, so that offsets do not count."""
    for values in episodes:
        yield values - values.mean()


@dataclass(frozen=True, kw_only=True)
class Line:
    """Regression of one signal on another: slope and correlation, over all episodes."""

    slope: float
    correlation: float


def line(cause: Sequence[Array], effect: Sequence[Array]) -> Line:
    """The regression of `effect` on `cause`; the correlation is 0 where either stands still."""
    x, y = (np.concatenate(list(centred(part))) for part in (cause, effect))
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return Line(slope=0.0, correlation=0.0)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    size = max(float(np.abs(np.concatenate(cause)).max()), 1e-12)
    if xx <= len(x) * (STILL * size) ** 2 or yy <= 0.0:
        return Line(slope=0.0, correlation=0.0)
    return Line(slope=xy / xx, correlation=xy / np.sqrt(xx * yy))


def correlations(cause: Sequence[Array], effect: Sequence[Array], used: Sequence[Array]) -> Array:
    """Correlations of causes (L, T) and one effect (T,) over the samples used (L, T), as `line`."""
    xx, yy, xy, count, most = np.zeros((5, len(cause[0])))
    for c, e, u in zip(cause, effect, used, strict=True):
        every = np.maximum(u.sum(axis=1, keepdims=True), 1)
        x, y = (np.where(u, v, 0.0) for v in (c, e))
        most = np.maximum(most, np.abs(x).max(axis=1, initial=0.0))
        x, y = (np.where(u, v - v.sum(axis=1, keepdims=True) / every, 0.0) for v in (x, y))
        xx, yy, xy = xx + (x * x).sum(axis=1), yy + (y * y).sum(axis=1), xy + (x * y).sum(axis=1)
        count = count + u.sum(axis=1)
    still = (xx <= count * (STILL * np.maximum(most, 1e-12)) ** 2) | (yy <= 0.0)
    found = np.where(still, 0.0, xy / np.sqrt(np.where(still, 1.0, xx * yy)))
    return np.nan_to_num(found, nan=0.0)
