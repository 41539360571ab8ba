"""The free-air episodes of a log as arrays: what was asked of a limb, and what it then showed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from backends.spec import Spec
from backends.state import Array
from diagnosis.logs._columns import SENT
from diagnosis.logs.log import EpisodeMeta, Log, LogError, signal

FREE_AIR = ("steps", "triangle", "multisine", "push", "free")
"""Protocols without a stick in the hand."""
CHANNELS = ("position", "motor", "torque")
"""What is compared, in this order."""
LEAST_SAMPLES, LEAST_S = 20, 2.0
"""Shorter episodes are left out; less free air than this tells no causes apart [s]."""
REST_SAMPLES = 3
"""The start is the mean of so many readings."""
CLOSE_SD = 3.0
"""A start is at its target where noise hides whether it is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One episode of K joints, a row per sample."""

    protocol: str
    time_s: Array
    """From the first sample on [s], shape (T,)."""
    command: Array
    """Commanded angle from each sample on [rad], shape (T, K)."""
    push: Array
    """Known external torque on the joint from each sample on [Nm], shape (T, K)."""
    measured: Array
    """Readings by `CHANNELS`, shape (T, 3, K); NaN where none were logged."""
    start: Array
    """What the position sensors read at the start [rad], shape (K,)."""
    rate: Array | None = None
    """Speeds at the start [rad/s], shape (K,); None: it begins at rest."""
    episode: int = 0
    """Number of its episode in the log."""
    began_s: float = 0.0
    """When in that episode its first sample is [s]."""
    speed: Array | None = None
    """Speed of the target that is given beside it [rad/s], shape (T, K); NaN: none is."""
    torque: Array | None = None
    """Torque that is given beside it [Nm], shape (T, K); NaN: none is."""
    sent_s: Array | None = None
    """When the command of each sample begins to act [s], shape (T,); None: with its sample."""
    own: Array | None = None
    """How much further the model's own simulator moves the joints, with its step, integrator and
    soft friction, than small steps with firm friction do [rad], shape (T, K); None: not known."""

    def part(self, begin: int, end: int) -> "Recording":
        """Its samples from `begin` to before `end`."""
        names = ("command", "push", "measured", "speed", "torque", "sent_s", "own")
        every = {name: getattr(self, name) for name in names}
        rows: dict[str, Any] = {k: None if v is None else v[begin:end] for k, v in every.items()}
        at_s = float(self.time_s[begin])
        if self.sent_s is not None:
            rows["sent_s"] = rows["sent_s"] - at_s
        return replace(
            self, time_s=self.time_s[begin:end] - at_s, began_s=self.began_s + at_s, **rows
        )

    @cached_property
    def asked(self) -> Array:
        """All that drives are given from each sample on, shape (T, A)."""
        more = np.nan_to_num(self.given).transpose(2, 0, 1) if len(self.given) else ()
        return np.concatenate([self.command, *more], axis=1)

    @cached_property
    def given(self) -> Array:
        """Speeds and torques that are given, shape (T, K, 2); (0, K, 2) where none are."""
        if self.speed is None or self.torque is None:
            return np.zeros((0, self.command.shape[1], 2))
        return np.stack([self.speed, np.nan_to_num(self.torque)], axis=2)


def recordings(log: Log, limb: Spec) -> tuple[Recording, ...]:
    """All usable episodes of a log in free air; raises LogError where there are none."""
    return lasting([recording(log, limb, one) for one in episodes_of(log, limb)])


def episodes_of(log: Log, limb: Spec) -> list[EpisodeMeta]:
    """The episodes in free air; raises LogError unless a log has commands for a limb's joints."""
    require_joints(log, limb.hand.joint_names)
    return [one for one in log.episodes if one.protocol in FREE_AIR]


def lasting(every: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings that are not too short; raises LogError where all together are."""
    found = tuple(r for r in every if len(r.time_s) >= LEAST_SAMPLES)
    lasts_s = sum(float(r.time_s[-1]) for r in found)
    if lasts_s < LEAST_S:
        raise LogError(
            f"not identifiable from this log: {lasts_s:.3g} s in free air in episodes of "
            f"{LEAST_SAMPLES} samples or more, allowed: from {LEAST_S:g} s; record "
            f"{', '.join(FREE_AIR[:4])}"
        )
    return found


def require_joints(log: Log, names: Sequence[str]) -> None:
    """Raise LogError unless a log has commands for these joints."""
    if missing := [name for name in names if name not in log.joints]:
        raise LogError(
            f"this log has no commands for {', '.join(missing)}; it has: {', '.join(log.joints)}; "
            "record every joint"
        )


def stood_s(time_s: Array, asked: Array, least: float = 0.0) -> Array:
    """How long (T,) [s] no target of (T,) or (T, K) has moved by more than `least` in a sample."""
    moved = np.abs(np.diff(asked, axis=0, prepend=asked[:1])).reshape(len(asked), -1) > least
    row = np.where(moved.any(axis=1), np.arange(len(asked)), 0)
    return time_s - time_s[np.maximum.accumulate(row)]


def white_noise(measured: Array) -> Array:
    """Standard deviation of white noise by column of (T, ...): third differences of it."""
    thirds = (np.abs(np.diff(x, n=3)) for x in measured.reshape(len(measured), -1).T)
    found = [float(noise_of(x)) if np.isfinite(x).any() else np.nan for x in thirds]
    return np.reshape(found, measured.shape[1:])


def noise_of(third: Array) -> Array:
    """Standard deviation of white noise with third differences of these sizes (T, ...)."""
    return np.nanmedian(third, axis=0) / 0.6745 / np.sqrt(20.0)


def recording(log: Log, limb: Spec, episode: EpisodeMeta, some: slice = slice(None)) -> Recording:
    """One episode of a limb, or some of its rows."""
    names, number = limb.hand.joint_names, episode.episode
    whole_s = log.episode(number)["t_s"].to_numpy(float)
    time_s = whole_s[some]
    later = np.append(True, np.diff(np.maximum.accumulate(time_s)) > 0)
    rows = slice(None) if later.all() else later

    frame = log.episode(number).iloc[some]

    def read(kind: str) -> Array:
        return signal(log, frame, kind, names)[rows]

    command, push, speed, torque = map(read, ("command", "push", "reference", "feedforward"))
    measured = np.empty((len(command), len(CHANNELS), len(names)))
    for row, kind in enumerate(CHANNELS):
        measured[:, row] = read(kind)
    sent_s = np.asarray(frame.get(SENT, np.nan * whole_s[some]), dtype=float)[rows] - time_s[0]
    given = bool(np.isfinite(speed).any() or np.isfinite(torque).any())
    return Recording(
        protocol=episode.protocol,
        time_s=time_s[rows] - time_s[0],
        command=command,
        push=np.nan_to_num(push, copy=False),
        measured=measured,
        start=_start(measured[:, 0], command[0]),
        episode=number,
        began_s=float(time_s[0] - whole_s[0]),
        speed=speed if given else None,
        sent_s=sent_s if np.isfinite(sent_s).all() else None,
        torque=torque if given else None,
    )


def _start(position: Array, target: Array) -> Array:
    """Where joints rest before they move (K,): as read, or at the target within the noise.

    A joint that moves at once rests at its first reading.
    """
    first = position[:REST_SAMPLES]
    noise = white_noise(position) if len(position) > REST_SAMPLES else np.zeros(len(target))
    moves = np.ptp(first, axis=0) > 2.0 * CLOSE_SD * noise
    read = np.where(moves, first[0], first.mean(axis=0))
    rests = np.abs(read - target) < CLOSE_SD * noise / np.sqrt(REST_SAMPLES)
    return np.where(rests, target, read)
