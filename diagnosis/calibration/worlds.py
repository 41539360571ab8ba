"""Replay a log's commands in many candidate worlds at once on an engine.

A refit is one batch of worlds that differ in numbers. The engine is passed in, so that any engine
can simulate the nominal world.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from backends.engine import Simulator
from backends.spec import Spec
from backends.state import Array
from diagnosis.logs.log import EpisodeMeta, Log
from diagnosis.motion.batch import FOREVER_S, Simulate, at_rest, states, together
from diagnosis.motion.recordings import REST_SAMPLES

READINGS = ("position", "motor")
"""Outputs of a replay: readings of the position sensor and angles of the motor."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Commands and readings of one episode, or of its beginning."""

    episode: int
    protocol: str
    tick: Array
    """Drive periods from the start to each sample, shape (T,)."""
    command_rad: Array
    """Targets from each sample on [rad], shape (T, J)."""
    push_nm: Array
    """Known torques on the joints from each sample on [Nm], shape (T, J); else 0."""
    read_rad: Array
    """Readings [rad], shape (2, T, J) in the order of `READINGS`; NaN where not logged."""

    def first(self, ticks: int) -> "Motion":
        """The beginning, up to so many drive periods."""
        keep = self.tick <= ticks
        cut = {f: getattr(self, f)[keep] for f in ("tick", "command_rad", "push_nm")}
        return dataclasses.replace(self, **cut, read_rad=self.read_rad[:, keep])


def motions(
    log: Log, joints: Sequence[str], drive_s: float, protocols: Iterable[str]
) -> list[Motion]:
    """The episodes of some protocols; joints are in the given order of the spec."""
    wanted = set(protocols)
    return [_motion(log, joints, drive_s, e) for e in log.episodes if e.protocol in wanted]


def _motion(log: Log, joints: Sequence[str], drive_s: float, episode: EpisodeMeta) -> Motion:
    number = episode.episode
    time_s = log.episode(number)["t_s"].to_numpy(dtype=float)
    return Motion(
        episode=number,
        protocol=episode.protocol,
        tick=np.round((time_s - time_s[0]) / drive_s).astype(np.int64),
        command_rad=log.signal("command", number, joints),
        push_nm=np.nan_to_num(log.signal("push", number, joints)),
        read_rad=np.stack([log.signal(kind, number, joints) for kind in READINGS]),
    )


def replay(
    simulate: Simulate,
    specs: Sequence[Spec],
    motions: Sequence[Motion],
    offset_rad: Array | None = None,
) -> list[Array]:
    """The readings of every world: per motion, shape (W, 2, T, J) with `READINGS` second.

    Joints start at their position in the log, plus `offset_rad` (W, J).
    """
    steps = [np.diff(m.tick) for m in motions]
    stride = int(np.gcd.reduce(np.concatenate(steps)))
    pairs = [(_aside(spec, stride), _Path(motion, stride)) for spec in specs for motion in motions]
    start = np.stack([path.start_rad for _, path in pairs])
    e = len(motions)
    if offset_rad is not None:
        start += np.repeat(offset_rad, e, axis=0)
    shown = _run(simulate([world for world, _ in pairs]), start, [path for _, path in pairs])
    rows = [m.tick // stride for m in motions]
    return [shown[rows[k]][:, :, k::e].transpose(2, 1, 0, 3) for k in range(e)]


class _Path:
    """A motion on the regular time grid of a batch: targets and loads of each step."""

    def __init__(self, motion: Motion, stride: int) -> None:
        row = motion.tick // stride
        held = np.searchsorted(row, np.arange(row[-1] + 1), side="right") - 1
        # the start is the mean of some readings at rest, of the motor if it was logged
        joint_rad, motor_rad = motion.read_rad[:, :REST_SAMPLES].mean(axis=1)
        self.start_rad = np.where(np.isfinite(motor_rad), motor_rad, joint_rad)
        self.command_rad, self.push_nm = motion.command_rad[held], motion.push_nm[held]


def _run(simulator: Simulator, start: Array, paths: Sequence[_Path]) -> Array:
    """Readings at every step of the grid, shape (steps, 2, N, J)."""
    target, load = (
        together([getattr(p, name) for p in paths]) for name in ("command_rad", "push_nm")
    )
    every = states(simulator, at_rest(start), target, load)
    return np.stack([np.stack([state.measured_rad, state.motor_rad]) for state in every])


def _aside(spec: Spec, stride: int) -> Spec:
    """The world with steps of `stride` drive periods and the stick out of the way."""
    timing = dataclasses.replace(
        spec.timing, policy_s=stride * spec.timing.drive_s, weightless_s=FOREVER_S
    )
    return dataclasses.replace(spec, timing=timing)
