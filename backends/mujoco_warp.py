"""MuJoCo Warp: many worlds on an NVIDIA GPU; on a CPU the same, slowly, for tests.

The model is MuJoCo's own (`backends.mujoco`), in single precision. A policy period runs on the
device: the drives as a kernel, then MuJoCo Warp's step, tick by tick.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from mujoco.batch import MODEL_FIELDS

from backends._mujoco_worlds import differences
from backends._warp_drive import carry_tick, drive_tick
from backends.drive import MEMORY, drive_table
from backends.engine import EXACT, SHARED_SUPPORT, Engine, Team
from backends.mujoco import Backend as Mujoco
from backends.mujoco import compiled
from backends.spec import Spec
from backends.state import Array, InitialState, State, quat_to_matrix

CONTACTS, ROWS_PER_CONTACT = 24, 4
"""Contacts that a world has room for, and constraint rows of each (condim 4, elliptic cone)."""
_SINGLE = "approximate: 32-bit floats, relative error 6e-8"
_ONE_PER_BATCH = ("geom_type", "geom_priority")
"""What MuJoCo Warp keeps once for all worlds that are stepped together."""

wp.config.log_level = wp.LOG_WARNING  # the rest goes to standard output
if not wp.is_cuda_available():
    wp.config.optimization_level = 0  # half as fast, compiled in a third of the time


class Backend(Engine):
    """N worlds in batches of one stick shape, on the GPU where there is one."""

    package = "mujoco-warp"
    only_by_name = True
    own = Mujoco.own
    support = {
        name: _SINGLE if answer == EXACT and name not in SHARED_SUPPORT else answer
        for name, answer in Mujoco.support.items()
    }

    def __init__(self, specs: Sequence[Spec]) -> None:
        super().__init__(specs)
        made = {spec.digest: _model(spec) for spec in {s.digest: s for s in specs}.values()}
        models = [made[spec.digest] for spec in specs]
        kinds: dict[tuple, list[int]] = {}
        for n, model in enumerate(models):
            kind = tuple(getattr(model, name).tobytes() for name in _ONE_PER_BATCH)
            kinds.setdefault(kind, []).append(n)
        self._batches = [
            _Batch(np.array(ids), [models[n] for n in ids], self._teams[0], specs)
            for ids in kinds.values()
        ]

    def close(self) -> None:
        """Free the worlds."""
        self._batches = []

    def _place(self, ids: Array, initial: InitialState) -> None:
        for batch in self._batches:
            batch.place(np.isin(batch.ids, ids), initial)

    def _tick(self, rows: slice, torque_nm: Array, stick_force_n: Array | None) -> None:
        for batch in self._batches:
            force = 0.0 if stick_force_n is None else stick_force_n[batch.ids]
            batch.push(torque_nm[batch.ids], force)
            batch.read_joints(self.state)

    def _drive(
        self, team: Team, target_rad: Array, load_nm: Array | None, stick_force_n: Array | None
    ) -> Array:
        """As in `_period`, so that a world moves alike beside worlds of either kind."""
        torque = np.zeros_like(target_rad) if load_nm is None else load_nm.copy()
        for batch in self._batches:
            ids = batch.ids
            more = [None if one is None else one[ids] for one in (load_nm, stick_force_n)]
            torque[ids] += batch.drive(target_rad[ids], np.zeros(len(ids)), team, 1, *more)[:, 0]
            batch.read_joints(self.state)
        return torque

    def _period(
        self, team: Team, target_rad: Array, load_nm: Array | None, pull_n: Array | None
    ) -> None:
        if load_nm is not None or pull_n is not None or not team.plain:
            super()._period(team, target_rad, load_nm, pull_n)
            return
        lifted, ticks = team.lifted_ticks(self._age_steps), self._timing.substeps
        for batch in self._batches:
            ids = batch.ids
            self.applied_nm[ids] = batch.drive(target_rad[ids], lifted[ids], team, ticks)
            batch.read_joints(self.state)
        self._age_steps += ticks

    def _observe(self, rows: slice) -> None:
        contacts = [batch.observe(self.state) for batch in self._batches]
        self._pool_contacts(rows, np.concatenate(contacts))


def _model(spec: Spec) -> mujoco.MjModel:
    """MuJoCo's model, less what MuJoCo Warp does not know or is not asked for."""
    model, off = compiled(spec), mujoco.mjtDisableBit
    model.opt.disableflags &= ~int(off.mjDSBL_AUTORESET)  # it never resets by itself
    model.opt.disableflags |= int(off.mjDSBL_SENSOR)
    return model


class _Batch:
    """Worlds `ids` (n,) that are stepped together."""

    def __init__(
        self, ids: Array, models: Sequence[mujoco.MjModel], team: Team, specs: Sequence[Spec]
    ) -> None:
        model, hand = models[0], specs[0].hand
        self.ids = ids
        self._model = mjw.put_model(model)
        for name, values in differences(models, MODEL_FIELDS).items():
            self._keep_per_world(name, values)
        rows = CONTACTS * ROWS_PER_CONTACT
        self._data = mjw.make_data(model, nworld=len(ids), nconmax=CONTACTS, njmax=rows)
        joints = [model.joint(name) for name in hand.joint_names]
        free = model.joint("stick")
        self._joint_q, self._joint_v = (
            np.array([getattr(joint, name)[0] for joint in joints], dtype=np.int32)
            for name in ("qposadr", "dofadr")
        )
        self._stick_q = slice(free.qposadr[0], free.qposadr[0] + 7)
        self._stick_v = slice(free.dofadr[0], free.dofadr[0] + 6)
        self._finger_of = np.full(model.ngeom, -1)
        self._finger_of[[model.geom(tip.finger).id for tip in hand.fingertips]] = range(
            len(hand.fingertips)
        )
        shape = len(ids), len(joints)
        self._target, self._motor, self._speed, self._pd = (
            wp.zeros(shape, dtype=wp.float64) for _ in range(4)
        )
        ticks = specs[0].timing.substeps
        self._gear = wp.zeros((len(ids), ticks, len(joints)), dtype=wp.float64)
        self._tick_of = wp.zeros(len(ids), dtype=int)
        numbers = np.array([drive_table(specs[n]) for n in ids])
        self._numbers = wp.array(numbers, dtype=wp.float64)
        self._drives = [
            *(self._target, self._data.qpos, self._data.qvel),
            *(wp.array(self._joint_q), wp.array(self._joint_v)),
            *(self._numbers, wp.float64(specs[0].timing.drive_s)),
            *(self._motor, self._speed, self._pd),
            *(self._tick_of, self._gear, self._data.qfrc_applied),
        ]
        self._lifted = wp.zeros(len(ids), dtype=int)
        self._carry = [
            *(self._tick_of, self._lifted, wp.array(team.carry_n[ids], dtype=float)),
            *(self._stick_v.start, self._data.qfrc_applied),
        ]
        self._contacts = wp.array(np.arange(self._data.naconmax, dtype=np.int32))
        self._forces = wp.zeros(self._data.naconmax, dtype=wp.spatial_vector)
        self._graph: Any = None
        """On a GPU, all kernels of a tick, recorded after the first period."""

    def _keep_per_world(self, name: str, values: Array) -> None:
        if name == "opt.impratio":
            name, values = "opt.impratio_invsqrt", values**-0.5
        *path, last = name.split(".")
        owner = getattr(self._model, path[0]) if path else self._model
        one = getattr(owner, last, None)
        if one is None or name == "dof_length":
            return  # derived by MuJoCo; MuJoCo Warp has no use for it (the latter is of sleep)
        if one.shape[0] != 1:
            raise ValueError(f"worlds of MuJoCo Warp that differ in {name} cannot be one batch")
        shape = len(values), *one.numpy().shape[1:]
        setattr(owner, last, wp.array(values.reshape(shape), dtype=one.dtype))

    def place(self, mask: Array, initial: InitialState) -> None:
        """Place the masked of the batch's worlds (n,)."""
        mjw.reset_data(self._model, self._data, wp.array(mask, dtype=bool))
        qpos, ids = self._data.qpos.numpy(), self.ids[mask]
        qpos[np.ix_(mask, self._joint_q)] = initial.joint_rad[ids]
        qpos[mask, self._stick_q] = np.hstack(
            [initial.stick_pos_m[ids], initial.stick_quat_wxyz[ids]]
        )
        self._data.qpos.assign(qpos)
        numbers = self._numbers.numpy()
        numbers[mask, :, -len(MEMORY) :] = 0.0
        self._numbers.assign(numbers)

    def push(self, torque_nm: Array, force_n: Array | float) -> None:
        """Step once under given torques (n, J) and forces on the sticks (n, 3)."""
        applied = np.zeros(self._data.qfrc_applied.shape, dtype=np.float32)
        applied[:, self._joint_v] = torque_nm
        applied[:, self._stick_v.start : self._stick_v.start + 3] = force_n
        self._data.qfrc_applied.assign(applied)
        mjw.step(self._model, self._data)

    def drive(
        self,
        target_rad: Array,
        lifted: Array,
        team: Team,
        ticks: int,
        load_nm: Array | None = None,
        force_n: Array | None = None,
    ) -> Array:
        """Step under the drives, which hold the targets (n, J), and under loads and forces.

        Returns the torques of the drives (n, T, J).
        """
        bank = team.drives
        rotors = [
            (self._motor, bank.motor_rad),
            (self._speed, bank.motor_rad_s),
            (self._pd, bank.pd_nm),
        ]
        self._tick_of.zero_()
        self._target.assign(target_rad)
        self._lifted.assign(lifted.astype(np.int32))
        for here, there in rotors:
            here.assign(there[self.ids])
        bare = load_nm is None and force_n is None
        for _ in range(ticks):
            if bare and self._graph is not None:
                wp.capture_launch(self._graph)
            else:
                self._tick(load_nm, force_n)
        if bare and self._graph is None and wp.get_device().is_cuda:
            with wp.ScopedCapture() as capture:
                self._tick()
            self._graph = capture.graph
        for here, there in rotors:
            there[self.ids] = here.numpy()
        return self._gear.numpy()

    def _tick(self, load_nm: Array | None = None, force_n: Array | None = None) -> None:
        wp.launch(drive_tick, dim=self._target.shape, inputs=self._drives)
        wp.launch(carry_tick, dim=len(self.ids), inputs=self._carry)
        if load_nm is not None or force_n is not None:
            applied = self._data.qfrc_applied.numpy()
            applied[:, self._joint_v] += 0.0 if load_nm is None else load_nm
            stick = slice(self._stick_v.start, self._stick_v.start + 3)
            applied[:, stick] += 0.0 if force_n is None else force_n
            self._data.qfrc_applied.assign(applied)
        mjw.step(self._model, self._data)

    def read_joints(self, state: State) -> None:
        """Write joint angles and speeds into `state`."""
        state.joint_rad[self.ids] = self._data.qpos.numpy()[:, self._joint_q]
        state.joint_rad_s[self.ids] = self._data.qvel.numpy()[:, self._joint_v]

    def observe(self, state: State) -> Array:
        """Write poses and twists of the sticks into `state`; returns contacts to pool (C, 9)."""
        stick = self._data.qpos.numpy()[:, self._stick_q].astype(np.float64)
        twist = self._data.qvel.numpy()[:, self._stick_v].astype(np.float64)
        state.stick_pos_m[self.ids], state.stick_quat_wxyz[self.ids] = stick[:, :3], stick[:, 3:]
        state.stick_vel_m_s[self.ids] = twist[:, :3]
        rotation = quat_to_matrix(stick[:, 3:])
        state.stick_omega_rad_s[self.ids] = np.einsum("nij,nj->ni", rotation, twist[:, 3:])
        mjw.contact_force(self._model, self._data, self._contacts, False, self._forces)
        contact, count = self._data.contact, min(self._data.nacon.numpy()[0], len(self._contacts))
        finger = self._finger_of[contact.geom.numpy()[:count]]
        load = np.maximum(self._forces.numpy()[:count, :1].astype(np.float64), 0.0)
        # A normal points from the first shape to the second; here from the finger to the stick.
        outwards = np.where(finger[:, :1] >= 0, 1.0, -1.0)
        normal = outwards * contact.frame.numpy()[:count, 0]
        world = self.ids[contact.worldid.numpy()[:count, None]]
        table = [world, finger.max(axis=1)[:, None], load, load * contact.pos.numpy()[:count]]
        return np.hstack([*table, -load * normal])
