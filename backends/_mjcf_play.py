"""A user's robot in plain MuJoCo: its own file, its own actuators, nothing of this project."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from backends._mjcf_model import compiled
from backends._mjcf_robot import Robot
from backends.state import Array

IMMOVABLE_KGM2 = 1e12
"""Inertia of a joint that is held: no robot moves it by 1e-7 in a log."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Play:
    """One episode of K joints: what is asked of them from each of T samples on."""

    time_s: Array
    """From 0 on [s], shape (T,)."""
    command: Array
    """Targets [rad or m], shape (T, K)."""
    push: Array
    """External torques [Nm or N], shape (T, K)."""
    start: Array
    """Positions at rest [rad or m], shape (K,)."""


class Plain:
    """A text's model in free air, of which only some joints move."""

    def __init__(
        self,
        xml: str,
        joints: Sequence[str],
        held: Mapping[str, float],
        *,
        weightless: bool = False,
        timestep_s: float | None = None,
        integrator: str | None = None,
        beside: dict[str, dict[str, float]] | None = None,
    ) -> None:
        """Hold all but `joints`; `weightless`: the drives carry all weight.

        `timestep_s` and `integrator` in place of the file's; `beside`: what an MJCF cannot hold, as
        `Robot` takes it. Raises MjcfError.
        """
        model = copy.copy(compiled(xml))
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.gravity[:] *= 0.0 if weightless else 1.0
        model.opt.timestep = timestep_s or model.opt.timestep
        if integrator is not None:
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        own = [model.joint(name).id for name in joints]
        moving = [j for j in range(model.njnt) if _behind(model.joint(j).name, joints) in joints]
        still = np.setdiff1d(np.arange(model.nv), model.jnt_dofadr[moving])
        model.dof_armature[still], model.dof_frictionloss[still] = IMMOVABLE_KGM2, 0.0
        model.eq_active0[:] = 0
        self.model, self._at = model, model.jnt_qposadr[own]
        self._joints, self._beside = tuple(joints), beside or {}
        self._pushed = [
            (int(model.jnt_dofadr[j]), _behind(model.joint(j).name, joints)) for j in moving
        ]
        self._pose = model.qpos0.copy()
        for name, value in held.items():
            self._pose[model.joint(name).qposadr[0]] = value

    def positions(self, play: Play) -> Array:
        """Positions of the joints at the samples (T, K), with servos that follow the commands."""
        robot = Robot(self.model, self._beside)
        robot.data.qpos[:] = self._pose
        robot.data.qpos[self._at] = self._unread(play.start)
        ticks = np.round(play.time_s / self.model.opt.timestep).astype(int)
        shown = np.empty(play.command.shape)
        for k, target in enumerate(play.command):
            targets = dict(zip(self._joints, map(float, target), strict=True))
            for dof, name in self._pushed:
                robot.data.qfrc_applied[dof] = play.push[k, self._joints.index(name)]
            for n in range(
                max((ticks[k + 1] if k + 1 < len(ticks) else ticks[k] + 1) - ticks[k], 1)
            ):
                read = robot.step(targets)
                shown[k] = shown[k] if n else list(read.values())
        return shown

    def _unread(self, reading: Array) -> Array:
        """Where joints stand whose sensors read this (K,)."""
        own = [self._beside.get(name, {}) for name in self._joints]
        scale, bias = (np.array([one.get(n, 0.0) for one in own]) for n in ("scale", "bias"))
        return np.asarray((reading - bias) / (1.0 + scale))


def _behind(name: str, joints: Sequence[str]) -> str:
    """The joint that a joint is, or is the play of."""
    return name if name in joints else name.removesuffix("_play")
