"""One limb's log beside its model: what its sensors would show, for any numbers of its joints."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from backends.command import rounded
from backends.drive import stops
from backends.encoder import angles
from backends.spec import Spec
from backends.state import Array
from diagnosis.logs.log import LogError
from diagnosis.motion import columns as c
from diagnosis.motion.along import AXES, Along, Model, smoothed, turned
from diagnosis.motion.integrate import UNTIL, integrate, sense
from diagnosis.motion.recordings import CHANNELS, Recording
from diagnosis.replay.dynamics import (
    POSES,
    carried,
    dynamics,
    holding,
    is_closed,
    link_inertia,
    springs,
)

POINT_S = 4e-3
"""Time between the points at which the rigid-body model is taken [s]."""
BLOCK_S = 8e-3
"""Samples are compared as means over this: slower than any joint, as white, and far fewer [s]."""
TICK_S, FINEST_S = 1e-3, 2e-5
"""Longest and shortest step of a rigid drive [s]."""
TICKS = 10
"""Ticks between samples are enough where those are far apart."""
NEAR_RAD = 0.02
"""The model is taken within half of this of where a joint is: beyond, weight bends by 5e-5."""
TRACKED_RAD_S = 20.0
"""A joint under torque alone drifts from any model: in a replay a spring and a critical damper hold
it to the measured motion, with this natural frequency, as a soft servo would."""
IMPEDANCE = 0.9
"""Of dry friction, MuJoCo's default."""
MOST_TICKS = 4e7
"""More take an episode too long."""
STABLE, FINE = 1.0, 0.05
"""A step is short enough where kp dt^2 is at most so many times the rotor's inertia, which a gear
may have to be put behind, and this share of all that the drive moves."""


Acts = tuple[Array, Array, Array]
"""At every tick (n,) the sample whose command acts, the share of it for which the one before does,
and the sample whose push acts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Limb:
    """K joints that move together, and their episodes."""

    spec: Spec
    recordings: tuple[Recording, ...]
    rigid: bool
    """Whether drives are rigid, as in a user's MJCF, instead of two masses with a gear."""
    exact: bool = False
    """Whether the law of its drives is ours: where it has a closed form, it is replayed as an
    engine would, instead of along the measured motion. Where play rattles, only that follows."""
    torque_read: int = UNTIL
    """Which torque a sample has: `UNTIL`, `THEN` or `FROM`."""
    reads_carried: bool = False
    """Whether it has the torque that drives carry weight with beside their laws."""

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in spec order."""
        return self.spec.hand.joint_names

    @cached_property
    def nominal(self) -> Array:
        """The nominal numbers of the joints, shape (K, len(COLUMNS))."""
        return c.table(self.spec, self.rigid)

    @cached_property
    def period_s(self) -> float:
        """Time between samples [s]: the median over all episodes."""
        return float(np.median(np.concatenate([np.diff(r.time_s) for r in self.recordings])))

    @cached_property
    def unsure_s(self) -> float:
        """How much earlier than they are taken to be commands may be sent, and then delayed [s]."""
        between = any(recording.sent_s is not None for recording in self.recordings)
        return self.period_s if between else 0.0

    @cached_property
    def dt(self) -> float:
        """Step of the replay [s]: the drive's period, or what a rigid drive needs."""
        if not self.rigid:
            return self.spec.timing.drive_s
        dt = max(TICK_S, self.period_s / TICKS)
        kp, rotor = self.nominal[:, c.KP], self.nominal[:, c.ROTOR]
        moved = rotor + self.link_inertia
        longest = np.sqrt(np.minimum(STABLE * rotor, FINE * moved) / np.maximum(kp, 1e-12)).min()
        while dt > FINEST_S and dt > min(longest, self.period_s):
            dt /= 2
        return dt

    @cached_property
    def link_inertia(self) -> Array:
        """The least inertia of each joint's links at starts of episodes [kg m^2], shape (K,)."""
        starts = np.array([r.start for r in self.recordings])
        mass, _ = dynamics(self.spec, starts, np.zeros_like(starts))
        return link_inertia(mass)

    @cached_property
    def soft(self) -> Array:
        """Regularisation of each joint's dry friction in MuJoCo [1/(kg m^2)], shape (K,).

        A joint that it holds creeps by this times `YIELD_S` per torque. With its default impedance,
        from `dof_invweight0`: "Solver parameters" in its documentation.
        """
        if not self.rigid:
            return np.zeros(len(self.joints))
        still = np.zeros((1, len(self.joints)))
        mass, _ = dynamics(self.spec, still, still)
        inverse = np.linalg.inv(mass[0] + np.diag(self.nominal[:, c.ROTOR]))
        return (1.0 - IMPEDANCE) / IMPEDANCE * np.diag(inverse)

    @cached_property
    def open(self) -> Array:
        """Joints whose drives feed no position back, shape (K,)."""
        return np.asarray(self.nominal[:, c.OPEN] > 0.0)

    @cached_property
    def servo(self) -> Array:
        """Stiffness [Nm/rad] and damping [Nms/rad] by which joints are held, shape (2, K).

        Those of their drives, or that hold an open loop to the measured motion, against its weight.
        """
        own = self.nominal[:, [c.KP, c.KD]].T
        if not self.open.any():
            return own
        slope = np.concatenate([path.model[2] for path in self.along])
        falls = -min(np.linalg.eigvalsh(slope + slope.transpose(0, 2, 1)).min() / 2, 0.0)
        inertia = self.nominal[:, c.ROTOR] + self.link_inertia
        stiffness = inertia * TRACKED_RAD_S**2 + falls
        return np.where(self.open, [stiffness, 2.0 * np.sqrt(inertia * stiffness)], own)

    @property
    def _springs(self) -> Array:
        """`servo` of open loops alone."""
        return np.where(self.open, self.servo, 0.0)

    @cached_property
    def stride(self) -> int:
        """Ticks between points of the model."""
        return max(1, round(max(POINT_S, self.period_s / 2) / self.dt))

    @cached_property
    def edges(self) -> tuple[Array, ...]:
        """First samples of the blocks of every episode, and the end."""
        size = max(1, round(BLOCK_S / self.period_s))
        found = []
        for recording in self.recordings:
            count = len(recording.time_s)
            starts = np.arange(0, max(count - size, 0) + 1, size)
            found.append(np.append(starts, count))
        return tuple(found)

    @cached_property
    def measured(self) -> Array:
        """Readings as block means, shape (N, 3, K); NaN where none were logged."""
        return self.means(lambda recording: recording.measured)

    def means(self, of: Callable[[Recording], Array]) -> Array:
        """Block means of rows (T, ...) of every episode, end to end (N, ...)."""
        pairs = zip(self.recordings, self.edges, strict=True)
        return np.concatenate([block_means(of(r), edges) for r, edges in pairs])

    @cached_property
    def time_s(self) -> tuple[Array, ...]:
        """When the blocks of every episode begin [s]."""
        pairs = zip(self.recordings, self.edges, strict=True)
        return tuple(r.time_s[edges[:-1]] for r, edges in pairs)

    def by_episode(self, blocks: Array) -> list[Array]:
        """Rows of all blocks (N, ...), of each episode."""
        return np.split(blocks, np.cumsum([len(edges) - 1 for edges in self.edges])[:-1])

    @cached_property
    def closed(self) -> bool:
        """Whether its model is in closed form."""
        return self.exact and not self.rigid and is_closed(self.spec)

    @cached_property
    def along(self) -> tuple[Along, ...]:
        """The rigid-body model along every episode, or at the poses that its closed form is of."""
        found = []
        if self.closed:
            q = np.ascontiguousarray(POSES[:, : len(self.joints)])
            poses = Along(spec=self.spec, angle_rad=q, speed_rad_s=0.0 * q, closed=True)
            return (poses,) * len(self.recordings)
        for number, ((row, *_), _) in enumerate(self._ticks):
            q, v = self._moved(number, self.nominal, len(row) // self.stride + 1)
            found.append(Along(spec=self.spec, angle_rad=q, speed_rad_s=v))
        return tuple(found)

    @cached_property
    def _models(self) -> Callable[[bytes, bytes, bytes], dict[Along, tuple[Along, Model]]]:
        """The models with loads (K, len(LINK)), a tilt (2,) and zeros (K,); few replays change any.

        They do not hold the limb, so that both go at once, with all that is large in them.
        """
        joints, gravity_m_s2 = len(self.joints), self.spec.gravity_m_s2
        paths = dict.fromkeys(self.along)

        @lru_cache(2)
        def moved(zeros: bytes) -> dict[Along, Along]:
            off = np.frombuffer(zeros)
            if not off.any():
                return {path: path for path in paths}
            return {path: replace(path, angle_rad=path.angle_rad - off) for path in paths}

        @lru_cache(2)
        def models(load: bytes, tilt: bytes, zeros: bytes) -> dict[Along, tuple[Along, Model]]:
            rows = np.frombuffer(load).reshape(joints, -1)
            gravity = turned(gravity_m_s2, np.frombuffer(tilt))
            return {path: (one, one.of(rows, gravity)) for path, one in moved(zeros).items()}

        return models

    def _zeros(self, numbers: Array) -> Array:
        """How far from the measured motion sensors with these numbers say that joints are (K,)."""
        off = (numbers - self.nominal)[:, [c.BIAS, c.ZERO]].sum(axis=1)
        return np.zeros_like(off) if self.closed else NEAR_RAD * np.round(off / NEAR_RAD)

    def _moved(self, number: int, numbers: Array, count: int) -> tuple[Array, Array]:
        """How an episode moved by sensors with these numbers: angles and speeds (P, K)."""
        points_s = (np.arange(count) + 0.5) * self.stride * self.dt
        pairs = zip(self._still[number].T, numbers[:, c.LATE], strict=True)
        time_s = self.recordings[number].time_s
        read = [np.interp(points_s + late, time_s, x) for x, late in pairs]
        q = unread(np.stack(read, axis=1), numbers)
        return q, np.gradient(q, points_s, axis=0) if count > 1 else np.zeros_like(q)

    @cached_property
    def _still(self) -> tuple[Array, ...]:
        return tuple(smoothed(_filled(r), self.period_s) for r in self.recordings)

    @cached_property
    def _ticks(self) -> tuple[tuple[Acts, Array], ...]:
        return tuple(_ticks(recording, self.dt) for recording in self.recordings)

    def held(self, recording: Recording) -> tuple[Array, Array, Array] | None:
        """The motion (T, K) that open loops are held to, by which stiffness and damping (K,)."""
        if not self.open.any():
            return None
        still = smoothed(_filled(recording), self.period_s)
        return unread(still, self.nominal), *self._springs

    def needed(self, spec: Spec) -> Array:
        """Torques (N, K) [Nm] that would move such a limb as this one moved, as block means.

        By inverse dynamics, without friction; of a slide forces.
        """

        def torque(recording: Recording) -> Array:
            q = smoothed(_filled(recording), self.period_s)
            if len(q) < 3:
                return holding(spec, q) - recording.push
            v = np.gradient(q, recording.time_s, axis=0)
            accel = np.gradient(v, recording.time_s, axis=0)
            mass, bias = dynamics(spec, q, v)
            turning = np.einsum("tij,tj->ti", mass, accel) + self.nominal[:, c.ROTOR] * accel
            return turning + bias + springs(spec, q) - recording.push

        return self.means(torque)

    def with_signals(self, **signals: Sequence[Array]) -> "Limb":
        """The same limb and motion with other `command` or `push` (T, K), or `sent_s` (T,)."""
        each = (dict(zip(signals, own, strict=True)) for own in zip(*signals.values(), strict=True))
        pairs = zip(self.recordings, each, strict=True)
        recordings = tuple(replace(r, **own) for r, own in pairs)
        timed = "sent_s" in signals
        ticks = tuple(_ticks(r, self.dt) for r in recordings) if timed else self._ticks
        return self.alike({"_ticks": ticks}, recordings=recordings)

    def with_steps(self, joint: int, step: float) -> "Limb":
        """The same limb and motion, a joint's targets rounded to a step on their way."""
        spec = c.with_numbers(self.spec, {self.joints[joint]: {c.COLUMNS[c.STEP]: step}})
        return self.alike({"nominal": c.table(spec, self.rigid)}, spec=spec)

    def in_half_steps(self) -> "Limb":
        """The same limb and motion, replayed in steps of half the length."""
        dt = self.dt / 2
        ticks = tuple(_ticks(recording, dt) for recording in self.recordings)
        return self.alike({"dt": dt, "stride": 2 * self.stride, "_ticks": ticks})

    def alike(self, known: Mapping[str, Any] | None = None, **changes: Any) -> "Limb":
        """With other fields; what follows from the motion stays, but for what is `known`."""
        other = replace(self, **changes)
        kept = "nominal", "period_s", "dt", "stride", "edges", "measured", "along", "soft"
        own = {name: getattr(self, name) for name in (*kept, "_models", "_ticks")}
        other.__dict__.update(own | dict(known or {}))
        return other

    def simulate(
        self,
        numbers: Array,
        tilt: Array | None = None,
        shift: Array | float = 0.0,
        edges: Sequence[Array] | None = None,
    ) -> Array:
        """What the sensors show, as block means (N, 3, K); NaN in episodes that diverge.

        `numbers` (K, len(COLUMNS)) of the joints; `tilt` (2,) of gravity about `AXES` and
        `shift` (K,) of the starts [rad]; `edges` of other blocks, see `every_sample`.
        """
        numbers, found = np.ascontiguousarray(numbers), []
        at_motor = np.array([body.joint.sensor == "motor" for body in self.spec.hand.driven])
        replays = zip(
            self.ticks(numbers, tilt, shift), self._ticks, edges or self.edges, strict=True
        )
        for ticks, (_, at), ends in replays:
            shown = np.full((len(ends) - 1, len(CHANNELS), len(self.joints)), np.nan)
            if ticks is not None:
                given = at_motor, self.torque_read, numbers, self.dt
                sense(ticks, at, ends, *given, shown)
            found.append(shown)
        every = np.concatenate(found)
        if self.reads_carried:
            every[:, 2] += self._carried(numbers[:, c.LINK].tobytes(), edges or self.edges)
        return every

    @cached_property
    def _carried(self) -> Callable[[bytes, Sequence[Array]], Array]:
        """Torques (N, K) by which drives with loads (K, len(LINK)) carry weight along the motion.

        Block means, between the edges of all episodes.
        """
        spec, every = self.spec, [unread(_filled(r), self.nominal) for r in self.recordings]

        @lru_cache(2)
        def torques(load: bytes, edges: tuple[bytes, ...]) -> Array:
            rows = np.frombuffer(load).reshape(len(spec.drives), -1)
            pairs = zip(spec.hand.driven, rows, strict=True)
            world = spec.with_driven(c.with_load(body, row) for body, row in pairs)
            ends = (np.frombuffer(one, dtype=int) for one in edges)
            q = [block_means(x, one) for x, one in zip(every, ends, strict=True)]
            return carried(world, np.concatenate(q))

        return lambda load, edges: torques(load, tuple(one.tobytes() for one in edges))

    @property
    def every_sample(self) -> list[Array]:
        """Edges of blocks of a single sample, by episode."""
        return [np.arange(len(recording.time_s) + 1) for recording in self.recordings]

    def ticks(
        self, numbers: Array, tilt: Array | None = None, shift: Array | float = 0.0
    ) -> Iterator[Array | None]:
        """Joints, motors and torques as `integrate` has them, by episode; None: it diverged."""
        tilt = np.zeros(len(AXES)) if tilt is None else tilt
        own_zeros = self._zeros(numbers).tobytes()
        models = self._models(numbers[:, c.LINK].tobytes(), tilt.tobytes(), own_zeros)
        starts = np.zeros((len(self.recordings), 2, len(numbers)))
        starts[:, 0] = unread(np.array([r.start for r in self.recordings]), numbers) + shift
        for start, one in zip(starts, self.recordings, strict=True):
            start[1] = 0.0 if one.rate is None else one.rate
        ranges = np.array([body.joint.range_rad for body in self.spec.hand.driven])
        ends = stops(numbers[:, [c.STOP, c.FIRM, c.STIFFNESS]], ranges)
        episodes = enumerate(zip(self.recordings, self.along, self._ticks, starts, strict=True))
        for number, (recording, path, (acts, _), start) in episodes:
            path, model = models[path]
            if self.open.any():
                model, start[1] = self._tracked(number, numbers, path, model)
            motion = path.angle_rad, path.speed_rad_s, model
            sent = rounded(recording.command, numbers[:, c.STEP])
            sent = sent - (1.0 - numbers[:, c.OPEN]) * numbers[:, c.ZERO]
            asked = sent, recording.given, recording.push, acts
            out = np.empty((len(acts[0]) + 1, len(CHANNELS), len(self.joints)))
            own = start, numbers, ends, self.soft, self.rigid
            given = self.dt, self.stride, *motion, *asked, *own
            yield out if integrate(*given, out) else None

    def _tracked(
        self, number: int, numbers: Array, path: Along, model: Model
    ) -> tuple[Model, Array]:
        """A model in which open loops are held to an episode's motion, and how fast it begins."""
        m, h, dq, dv, closed = model
        q, v = self._moved(number, numbers, len(path.angle_rad))
        stiffness, damping = self._springs
        h = h + stiffness * (path.angle_rad - q) + damping * (path.speed_rad_s - v)
        held = m, h, dq + np.diag(stiffness), dv + np.diag(damping), closed
        return held, np.where(self.open, v[0], 0.0)


def _filled(recording: Recording) -> Array:
    """Positions (T, K) with samples that do not count between their neighbours."""
    position = recording.measured[:, 0].copy()
    for column in position.T:
        known = np.isfinite(column)
        if not known.all() and known.any():
            column[~known] = np.interp(np.flatnonzero(~known), np.flatnonzero(known), column[known])
    return position


def unread(reading: Array, numbers: Array) -> Array:
    """Angles [rad] at which position sensors with these numbers read `reading` (K,)."""
    return angles(reading, *numbers[:, [c.BIAS, c.SCALE, c.ONCE, c.ACROSS, c.ZERO]].T)


def block_means(samples: Array, edges: Array) -> Array:
    """Means of rows (T, ...) between edges (B + 1,)."""
    counts = np.diff(edges).reshape(-1, *(1,) * (samples.ndim - 1))
    return np.add.reduceat(samples, edges[:-1], axis=0) / counts


def _ticks(recording: Recording, dt: float) -> tuple[Acts, Array]:
    """What acts at every tick, and the broken tick of every sample (T,)."""
    at = recording.time_s / dt
    first = np.round(at).astype(np.int64)
    if first[-1] > MOST_TICKS:
        raise LogError(f"an episode lasts {recording.time_s[-1]:.0f} s; split it")
    row = now = np.searchsorted(first, np.arange(first[-1] + 1), side="right") - 1
    kept = np.zeros(len(now))
    if recording.sent_s is not None:
        sent = np.clip(np.maximum.accumulate(recording.sent_s) / dt, 0.0, first[-1])
        sent[0] = 0.0
        first = np.floor(sent).astype(np.int64)
        kept[first] = sent - first
        row = np.searchsorted(first, np.arange(len(now)), side="right") - 1
    return (row, kept, now), at
