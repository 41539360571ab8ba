"""What all engines share: the drive loop at 1 kHz, episode ages, and the engine interface.

An engine's own file builds worlds, places hand and stick, steps with joint torques, and reports
primitives. Drives, the weightless start and the policy period are the same code for all engines and
stand here.
"""

import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

import numba
import numpy as np

from backends.command import CommandBank
from backends.drive import DriveBank
from backends.encoder import EncoderBank
from backends.spec import Spec, field_names
from backends.state import Array, InitialState, State, quat_z_axis
from backends.touch import stick_shape
from backends.weight import WeightBank

EXACT = "exact"
OUTRUN_M_S = 10.0
"""A stick that moves faster is no longer pulled: it would pass through a hand within one step
[m/s]."""
_SHARED = {"drive", "command", "encoder", "taxels", "timing", "joint", "hand"}
_PD_ALONE = "refused: drives have the PD law alone; a diagnosis replays a user's"
_REPLAYED = "refused: only a user's robot has it, which a diagnosis replays"
SHARED_SUPPORT: Mapping[str, str] = {
    **{
        name: _PD_ALONE if name.startswith("loop.") else EXACT
        for name in field_names()
        if name.split(".")[0] in _SHARED | {"loop"} and name != "joint.axis"
    },
    **dict.fromkeys(("joint.follows", "joint.course"), _REPLAYED),
    "body.carried": EXACT,
    "contact.touch_n": EXACT,
}
"""Support entries of the fields that shared code computes, the same for every engine."""


class Simulator(Protocol):
    """N simulated worlds: the part of an engine that tasks see."""

    specs: tuple[Spec, ...]

    def reset(self, initial: InitialState, mask: Array) -> State:
        """Start the masked worlds from `initial`; the others stay as they are."""
        ...

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """Hold the target angles (N, J) [rad] for one policy period; returns the state after it.

        `load_nm` (N, J) is an external torque on the joints, such as a push. `pull_n` (N,) is a
        force along the axis of each stick, towards its lower end. It acts while a fingertip touches
        the stick and the stick is slower than `OUTRUN_M_S`.
        """
        ...

    def close(self) -> None:
        """Free the engine; a second call is harmless."""
        ...


class Team:
    """Worlds that are stepped together through a policy period: their rows and signal paths."""

    def __init__(self, specs: Sequence[Spec], rows: slice, applied_nm: Array) -> None:
        own = specs[rows]
        self.rows = rows
        self.applied_nm = applied_nm[rows]
        """The rows of `Engine.applied_nm`."""
        self.commands, self.encoders = CommandBank(own), EncoderBank(own)
        self.drives = DriveBank(own)
        self.weight = WeightBank(own)
        signals = self.commands.acts or self.encoders.remembers
        self.plain = not signals and not self.weight.acts
        """Whether targets reach the drives unchanged, no sensor is late, and no weight is carried.
        """
        gravity = np.array([s.gravity_m_s2 for s in own])
        self.carry_n = -gravity * np.array([[s.stick.mass_kg] for s in own])
        """Forces (N, 3) [N] that carry the sticks."""
        lifted = [round(s.timing.weightless_s / s.timing.drive_s) for s in own]
        self.lifted_steps = np.array(lifted, dtype=np.int64)
        """Ages (N,) in drive periods up to which sticks are weightless."""

    def lifted_ticks(self, age: Array) -> Array:
        """Drive periods (N,) for which sticks stay weightless, given the worlds' `age` (N,)."""
        return np.maximum(self.lifted_steps - age, 0)

    def lift_n(self, age: Array) -> Array:
        """Forces (N, 3) [N] that carry the sticks, given their `age` (N,) in drive periods."""
        return np.where(age[:, None] < self.lifted_steps[:, None], self.carry_n, 0.0)


def _refuse_unbuildable(spec: Spec) -> None:
    """Raise ValueError for a world that no engine can build."""
    stick_shape(spec.stick)
    known: list[str | None] = [None]
    for body in spec.hand.bodies:
        if body.parent not in known:
            raise ValueError(f"'{body.name}' hangs on '{body.parent}', which is no body before it")
        known.append(body.name)


@numba.njit(cache=True)
def _pool(contacts, point, force):
    point[:], force[:] = 0.0, 0.0
    load = np.zeros(point.shape[:2])
    for row in contacts:
        n, f = int(row[0]), int(row[1])
        load[n, f] += row[2]
        for i in range(3):
            point[n, f, i] += row[3 + i]
            force[n, f, i] += row[6 + i]
    for n in range(load.shape[0]):
        for f in range(load.shape[1]):
            for i in range(3):
                point[n, f, i] /= max(load[n, f], 1e-12)


class Engine(ABC):
    """Base class of every backend; a subclass named `Backend` in its own file is one engine.

    `specs` are N worlds of the same structure that may differ in every number. Domain randomisation
    and the refitting of candidate worlds both use this.
    """

    package: ClassVar[str | None] = None
    """The installed package whose version `bench doctor` shows."""
    support: ClassVar[Mapping[str, str]]
    """Per spec field: 'exact', 'approximate: why' or 'refused: why'."""
    no_contacts: ClassVar[str] = ""
    """Why fingers and stick do not touch; empty: they do."""
    steps_in_threads: ClassVar[bool] = False
    """Whether the constructor takes `threads` (the engine frees the interpreter lock)."""
    only_by_name: ClassVar[bool] = False
    """Whether 'all' leaves the engine out: it is made for a GPU and slow without one."""
    own: ClassVar[Mapping[str, float]] = {}
    """How its contacts differ from the spec's numbers by themselves, by number, as
    `bench doctor physics` measures it. Two engines differ by an effect of the difference."""
    slop_m: ClassVar[float] = 0.0
    """Depth at which its contacts begin to press [m]."""
    worlds_in_cache: ClassVar[int] = sys.maxsize
    """How many worlds are stepped through a policy period together.

    An engine whose step reads much memory is up to twice as fast with few worlds at a time.
    """

    def __init__(self, specs: Sequence[Spec]) -> None:
        first = specs[0]
        if len({(s.timing.drive_s, s.timing.policy_s) for s in specs}) > 1:
            raise ValueError(
                "the worlds of one batch are stepped together; give them the same rates"
            )
        self._refuse(specs)
        for spec in specs:
            _refuse_unbuildable(spec)
        self.specs = tuple(specs)
        self._timing = first.timing
        self.state = State.allocate(
            len(specs), len(first.hand.joint_names), len(first.hand.fingertips)
        )
        self._age_steps = np.zeros(len(specs), dtype=np.int64)
        self._noise_seed = np.zeros(len(specs), dtype=np.int64)
        self.applied_nm = np.zeros((len(specs), self._timing.substeps, len(first.hand.joint_names)))
        """Torques on the joints in each drive period of the last policy period [Nm], (N, T, J)."""
        size = min(self.worlds_in_cache, len(specs))
        rows = [slice(n, min(n + size, len(specs))) for n in range(0, len(specs), size)]
        self._teams = [Team(self.specs, one, self.applied_nm) for one in rows]

    def reset(self, initial: InitialState, mask: Array) -> State:
        """Start the masked worlds from `initial`, at rest; the others stay as they are."""
        ids = np.flatnonzero(mask)
        self._place(ids, initial)
        for team in self._teams:
            team.drives.reset(initial.joint_rad[team.rows], mask[team.rows])
        self._age_steps[ids] = 0
        self._noise_seed[ids] = initial.noise_seed[ids]
        state = self.state
        state.joint_rad[ids] = initial.joint_rad[ids]
        state.motor_rad[ids] = initial.joint_rad[ids]
        state.stick_pos_m[ids] = initial.stick_pos_m[ids]
        state.stick_quat_wxyz[ids] = initial.stick_quat_wxyz[ids]
        for at_rest in (
            state.joint_rad_s,
            state.drive_torque_nm,
            state.stick_vel_m_s,
            state.stick_omega_rad_s,
            state.contact_point_m,
            state.contact_force_n,
        ):
            at_rest[ids] = 0.0
        self._measure()
        return state

    def advance(
        self, target_rad: Array, load_nm: Array | None = None, pull_n: Array | None = None
    ) -> State:
        """See `Simulator.advance`."""
        pull = None if pull_n is None else self._pull_n(pull_n)
        for team in self._teams:
            rows, drives = team.rows, team.drives
            load = None if load_nm is None else load_nm[rows]
            self._period(team, target_rad[rows], load, None if pull is None else pull[rows])
            self.state.motor_rad[rows] = drives.motor_rad
            self.state.drive_torque_nm[rows] = drives.pd_nm
            self._observe(rows)
        self._measure()
        return self.state

    def _pull_n(self, pull_n: Array) -> Array:
        """Forces (N, 3) [N] on the sticks, world frame; zero once a stick has left the grip."""
        state = self.state
        speed_m_s = np.linalg.norm(state.stick_vel_m_s, axis=1)
        there = state.contact_force_n.any(axis=(1, 2)) & (speed_m_s < OUTRUN_M_S)
        return -(pull_n * there)[:, None] * quat_z_axis(state.stick_quat_wxyz)

    def rollout(self, torque_nm: Array) -> None:
        """Step the bare engine under joint torques (N, T, J) [Nm], one after the other.

        The cost of everything else is measured against this: under the `applied_nm` of an engine in
        the same state, it takes the same steps. It updates joint angles and speeds only.
        """
        for team in self._teams:
            self._rollout(team, torque_nm[team.rows])

    def _rollout(self, team: Team, torque_nm: Array) -> None:
        """Step a team's worlds; an engine that can do so in one call overrides this."""
        age = self._age_steps[team.rows]
        for tick in range(torque_nm.shape[1]):
            lifts = team.lifted_ticks(age).any()
            self._tick(team.rows, torque_nm[:, tick], team.lift_n(age) if lifts else None)
            age += 1

    def _period(
        self, team: Team, target_rad: Array, load_nm: Array | None, pull_n: Array | None
    ) -> None:
        """Step a team's worlds through one policy period.

        Targets and loads are (N, J), forces on the sticks are (N, 3); None: no force.

        An engine that can run the drives in compiled code overrides this for teams that are
        `plain`.
        """
        rows, drives, encoders = team.rows, team.drives, team.encoders
        angle = self.state.joint_rad[rows]
        age, seed = self._age_steps[rows], self._noise_seed[rows]
        lifts = team.lifted_ticks(age).any()
        for tick in range(self._timing.substeps):
            load = load_nm
            if team.weight.acts:
                carried = team.weight.torque_nm(angle)
                load = carried if load_nm is None else load_nm + carried
            force = team.lift_n(age) if lifts else None
            if pull_n is not None:
                force = pull_n if force is None else force + pull_n
            target = team.commands.step(target_rad, age, seed)
            team.applied_nm[:, tick] = self._drive(team, target, load, force)
            age += 1
            if encoders.remembers:
                encoders.note(angle, drives.motor_rad, age)

    def _drive(
        self, team: Team, target_rad: Array, load_nm: Array | None, stick_force_n: Array | None
    ) -> Array:
        """Step a team's worlds by one drive period under targets (N, J), loads and forces.

        Returns the torques on the joints (N, J).
        """
        rows, state = team.rows, self.state
        torque = team.drives.step(target_rad, state.joint_rad[rows], state.joint_rad_s[rows])
        torque = torque if load_nm is None else torque + load_nm
        self._tick(rows, torque, stick_force_n)
        return torque

    def _refuse(self, specs: Sequence[Spec]) -> None:
        """Raise ValueError for a number that is not zero and that this engine cannot realise."""
        loaded = [spec.with_driven(body.loaded for body in spec.hand.driven) for spec in specs]
        for name, answer in self.support.items():
            asked = any(np.any(spec.values(name)) for spec in (*specs, *loaded))
            if asked and answer.startswith("refused"):
                raise ValueError(f"{name} is {answer}")

    def _measure(self) -> None:
        """Read the position sensors."""
        state = self.state
        for team in self._teams:
            rows, encoders = team.rows, team.encoders
            angles = state.joint_rad[rows], team.drives.motor_rad
            encoders.note(*angles, self._age_steps[rows])
            state.measured_rad[rows] = encoders.read(
                *angles, self._age_steps[rows], self._noise_seed[rows]
            )

    def _pool_contacts(self, rows: slice, contacts: Sequence[tuple] | Array) -> None:
        """Sum contacts per fingertip into `state`: load-weighted mean points, and forces.

        A contact holds: world of `rows`, fingertip, load [N], load times point (3) [N m], force (3)
        [N].
        """
        table = np.array(contacts, dtype=np.float64).reshape(-1, 9)
        _pool(table, self.state.contact_point_m[rows], self.state.contact_force_n[rows])

    def close(self) -> None:  # noqa: B027 - an engine may hold nothing
        """Free what the engine holds; a second call is harmless."""

    @abstractmethod
    def _place(self, ids: Array, initial: InitialState) -> None:
        """Place worlds `ids` at rest as in their rows of `initial`, without memory of the past."""

    @abstractmethod
    def _tick(self, rows: slice, torque_nm: Array, stick_force_n: Array | None) -> None:
        """Step the worlds `rows` by one drive period.

        Joint torques (N, J) and forces (N, 3) at the centres of the sticks (None: no force) act.
        Writes the new joint angles and speeds into `state.joint_rad` and `state.joint_rad_s`.
        """

    @abstractmethod
    def _observe(self, rows: slice) -> None:
        """Write stick pose, twist and fingertip contacts of the worlds `rows` into `state`."""


class RollingEngine(Engine):
    """Base class of engines that take many steps under given torques in one call."""

    def _tick(self, rows: slice, torque_nm: Array, stick_force_n: Array | None) -> None:
        force = np.zeros((len(torque_nm), 3)) if stick_force_n is None else stick_force_n
        self._step(rows, torque_nm[:, None], np.any(force, axis=1).astype(np.int64), force)

    def _rollout(self, team: Team, torque_nm: Array) -> None:
        age = self._age_steps[team.rows]
        self._step(team.rows, torque_nm, team.lifted_ticks(age), team.carry_n)
        age += torque_nm.shape[1]

    @abstractmethod
    def _step(self, rows: slice, torque_nm: Array, carried: Array, force_n: Array) -> None:
        """Step the worlds `rows` under joint torques (N, T, J), one after the other.

        Forces (N, 3) act at the centres of the sticks in the first `carried` (N,) steps. Writes the
        new joint angles and speeds, as `_tick` does.
        """
