"""A user's robot in plain MuJoCo: its own file, its own actuators, nothing of this project."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from backends._mjcf_actuators import acts
from backends._mjcf_model import compiled
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
    ) -> None:
        """Hold all but `joints`; `weightless`: the drives carry all weight.

        `timestep_s` and `integrator` in place of the file's. Raises MjcfError.
        """
        model = copy.copy(compiled(xml))
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.gravity[:] *= 0.0 if weightless else 1.0
        model.opt.timestep = timestep_s or model.opt.timestep
        if integrator is not None:
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        own = [model.joint(name).id for name in joints]
        still = np.setdiff1d(np.arange(model.nv), model.jnt_dofadr[own])
        model.dof_armature[still], model.dof_frictionloss[still] = IMMOVABLE_KGM2, 0.0
        model.eq_active0[:] = 0
        self.model, self._dofs, self._at = model, model.jnt_dofadr[own], model.jnt_qposadr[own]
        self._pairs = [
            (k, a, float(model.actuator_gear[a, 0]))
            for k, j in enumerate(own)
            for a in range(model.nu)
            if acts(model, a, j) and model.actuator_biasprm[a, 1] != 0.0
        ]
        self._pose = model.qpos0.copy()
        for name, value in held.items():
            self._pose[model.joint(name).qposadr[0]] = value

    def positions(self, play: Play) -> Array:
        """Positions of the joints at the samples (T, K), with servos that follow the commands."""
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[:] = self._pose
        data.qpos[self._at] = play.start
        ticks = np.round(play.time_s / model.opt.timestep).astype(int)
        shown = np.empty(play.command.shape)
        for k, target in enumerate(play.command):
            for column, a, gear in self._pairs:
                data.ctrl[model.actuator_ctrladr[a]] = gear * target[column]
            data.qfrc_applied[self._dofs] = play.push[k]
            shown[k] = data.qpos[self._at]
            for _ in range((ticks[k + 1] if k + 1 < len(ticks) else ticks[k]) - ticks[k]):
                mujoco.mj_step(model, data)
        return shown
