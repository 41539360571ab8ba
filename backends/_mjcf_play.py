"""A user's robot in plain MuJoCo: its own file, its own actuators, nothing of this project."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from backends._mjcf_followers import followers
from backends._mjcf_model import compiled
from backends._mjcf_robot import Drive, Signals
from backends.command import rounded
from backends.encoder import angles
from backends.state import Array

IMMOVABLE_KGM2 = 1e12
"""Inertia of a joint that is held: no robot moves it by 1e-7 in a log."""
FIRM = 0.999, 0.9999
"""Impedance of dry friction that holds."""
NOTHING: Mapping[str, dict[str, float]] = {}
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_ACTS = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED


@dataclass(frozen=True, kw_only=True, eq=False)
class Play:
    """One episode of K joints: what is asked of them from each of T samples on."""

    time_s: Array
    """From 0 on [s], shape (T,)."""
    command: Array
    """Targets [rad or m], shape (T, K)."""
    push: Array
    """External torques [Nm or N], shape (T, K)."""
    sent_s: Array | None = None
    """When each target begins to act [s], shape (T,); None: with its sample."""
    start: Array
    """Positions at the start [rad or m], shape (K,)."""
    rate: Array | None = None
    """Speeds there [rad/s or m/s], shape (K,); None: it begins at rest."""
    held: tuple[Array, Array, Array] | None = None
    """A motion (T, K) to which springs hold the joints, their stiffness and their damping (K,)."""


class Plain:
    """A text's model in free air, of which only some joints move."""

    def __init__(
        self,
        xml: str,
        joints: Sequence[str],
        held: Mapping[str, float],
        *,
        timestep_s: float | None = None,
        integrator: str | None = None,
        beside: Mapping[str, dict[str, float]] = NOTHING,
        drives: Mapping[str, dict[str, float]] = NOTHING,
    ) -> None:
        """Hold all but `joints` and what follows them.

        `timestep_s` and `integrator` in place of the file's; `beside` and `drives`: what an MJCF
        cannot hold, as a robot's file has it. Raises MjcfError.
        """
        model = copy.copy(compiled(xml))
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.timestep = timestep_s or model.opt.timestep
        if integrator is not None:
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        own = [model.joint(name).id for name in joints]
        led, _ = followers(model, own, held)
        moving = [j for j in range(model.njnt) if _behind(model.joint(j).name, joints) in joints]
        still = np.setdiff1d(np.arange(model.nv), model.jnt_dofadr[[*moving, *led]])
        model.dof_armature[still], model.dof_frictionloss[still] = IMMOVABLE_KGM2, 0.0
        model.eq_active0[:] = 0
        model.eq_active0[[one.equality for one in led.values()]] = 1
        self.model, self._at, self._own = model, model.jnt_qposadr[own], own
        self._led = {int(model.jnt_qposadr[j]): one for j, one in led.items()}
        self._joints, self._beside, self._drives = tuple(joints), beside, drives
        self._whose = np.array([joints.index(_behind(model.joint(j).name, joints)) for j in moving])
        self._places, self._dofs = model.jnt_qposadr[moving], model.jnt_dofadr[moving]
        self._pose = model.qpos0.copy()
        for name, value in held.items():
            self._pose[model.joint(name).qposadr[0]] = value

    def positions(self, play: Play) -> Array:
        """Positions of the joints at the samples (T, K), with servos that follow the commands.

        Signals and drives are as `backends.mjcf.robot_file` has them.
        """
        ticks = np.round(play.time_s / self.model.opt.timestep).astype(int)
        steps = np.maximum(np.diff(ticks, append=ticks[-1] + 1), 1)
        command, push = (np.repeat(x, steps, axis=0) for x in (play.command, play.push))
        if play.sent_s is not None:
            sent = np.maximum.accumulate(np.round(play.sent_s / self.model.opt.timestep))
            row = np.searchsorted(sent, np.arange(len(command)), side="right") - 1
            command = play.command[np.maximum(row, 0)]
        control = np.zeros((len(command), self.model.nu))
        applied = np.zeros((len(command), self.model.nv))
        passed = [Signals(self.model, name, self._beside.get(name, {})) for name in self._joints]
        for j, signals in enumerate(passed):
            sent = rounded(command[:, j], np.array(signals.step))
            target = _slowed(_late(sent, signals.late), signals.most)
            for place, gear in signals.servos:
                control[:, place] = gear * target
        applied[:, self._dofs] = push[:, self._whose]
        own = self._drives or play.held
        angle = (self._stepped if own else self._rolled)(play, control, applied)
        shown = [
            signals.shown(_late(angle[:, signals.places].sum(axis=1), signals.read_late))
            for signals in passed
        ]
        return np.stack(shown, axis=1)[np.cumsum(steps) - steps]

    def _stepped(self, play: Play, control: Array, applied: Array) -> Array:
        """`_rolled` step by step, with drives and with springs to a motion."""
        model = copy.copy(self.model)
        data, shown = mujoco.MjData(model), np.empty((len(control), model.nq))
        drives = [Drive(model, name, own) for name, own in self._drives.items()]
        self._place(data, play)
        if play.held:
            motion, stiffness, damping = play.held
            time_s = np.arange(len(control)) * model.opt.timestep
            q = np.stack([np.interp(time_s, play.time_s, x) for x in motion.T], axis=1)
            v = np.gradient(q, time_s, axis=0)
            data.qvel[model.jnt_dofadr[self._own]] = np.where(stiffness, v[0], 0.0)
        for k in range(len(control)):
            shown[k], data.ctrl[:], data.qfrc_applied[:] = data.qpos, control[k], applied[k]
            if play.held:
                angle, speed = (
                    np.bincount(self._whose, x[at], len(self._joints))
                    for x, at in ((data.qpos, self._places), (data.qvel, self._dofs))
                )
                more = stiffness * (q[k] - angle) + damping * (v[k] - speed)
                data.qfrc_applied[self._dofs] += more[self._whose]
            for drive in drives:
                drive.act(data)
            mujoco.mj_step(model, data)
        return shown

    def _rolled(self, play: Play, control: Array, applied: Array) -> Array:
        """All coordinates (S, Q) before each step."""
        data = mujoco.MjData(self.model)
        self._place(data, play)
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, data, state, _STATE)
        acts = np.concatenate([control, applied], axis=1)
        states, _ = rollout.rollout(
            self.model, data, state[None], acts[None], control_spec=int(_ACTS)
        )
        return np.vstack([state, states[0][:-1]])[:, 1 : 1 + self.model.nq]

    def _place(self, data: mujoco.MjData, play: Play) -> None:
        """Let joints be where sensors read its start, as fast as it is."""
        data.qpos[:] = self._pose
        data.qpos[self._at] = self._unread(play.start)
        data.qvel[self.model.jnt_dofadr[self._own]] = 0.0 if play.rate is None else play.rate
        for place, one in self._led.items():
            at = data.qpos[self.model.jnt_qposadr[one.leader]]
            data.qpos[place] = np.polynomial.polynomial.polyval(at, one.course)

    def _unread(self, reading: Array) -> Array:
        """Where joints stand whose sensors read this (K,)."""
        own = [self._beside.get(name, {}) for name in self._joints]
        names = ("bias", "scale", "cosine", "sine")
        return angles(reading, *(np.array([one.get(n, 0.0) for one in own]) for n in names))


def _behind(name: str, joints: Sequence[str]) -> str:
    """The joint that a joint is, or is the play of."""
    return name if name in joints else name.removesuffix("_play")


def _late(values: Array, ticks: float) -> Array:
    """Values (S,) so many steps ago, between steps linearly; the first one before it."""
    now, before = (values[np.maximum(np.arange(len(values)) - int(ticks) - k, 0)] for k in (0, 1))
    return np.asarray(now + (ticks - int(ticks)) * (before - now))


def _slowed(targets: Array, most: float) -> Array:
    """Targets (S,) that change by `most` in a step."""
    if np.abs(np.diff(targets, prepend=targets[0])).max() <= most:
        return targets
    slow, last = np.empty_like(targets), float(targets[0])
    for k, target in enumerate(targets.tolist()):
        last += min(max(target - last, -most), most)
        slow[k] = last
    return slow
