"""Build the spec of a user's mechanism from its MJCF file and the settings of its drives.

The model that MuJoCo's compiler makes of the file is written at the zero pose, where every joint
reads 0, in frames parallel to the world frame. In this project `armature` is the inertia on the
motor side of the gear; `damping` and `frictionloss` are the friction there. This module knows
nothing about logs.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from backends import sticks, trx
from backends._mjcf_checks import problems
from backends._mjcf_drives import Inertias, Servo, drives
from backends._mjcf_text import MjcfError, bounded
from backends.spec import Body, Drive, Joint, Spec, Timing, Vec3
from backends.state import Array
from files.bounded import one_line

__all__ = ["MjcfError", "Servo", "left_out", "mechanism"]

POSES = 32
"""Number of random poses, within the joint ranges, at which the inertias of the links are
evaluated."""
ROOM = {int(mujoco.mjtJoint.mjJNT_HINGE): np.pi, int(mujoco.mjtJoint.mjJNT_SLIDE): 1.0}
"""Range of a joint without limits, to either side [rad or m]."""
LEAST_KGM2 = 1e-9
"""Least inertia that a joint moves: that of a needle of 1 mg and 5 cm [kg m^2], of a slide [kg]."""
NEAR = 0.01
"""Distance from an end stop at which it may act, over the joint's range."""
FROM_FILES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD)
"""Geoms whose shape is in another file; the MJCF holds only its name."""


def mechanism(xml: str, servos: Mapping[str, Servo]) -> Spec:
    """The mechanism of an MJCF text with a drive on each joint.

    Palm, taxels and grip are copied from the default hand and touch nothing. Raises MjcfError.
    """
    model, name = _compiled(xml)
    wrong = problems(model, servos)
    if wrong:
        raise MjcfError("; ".join(wrong))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    names = [model.joint(j).name for j in range(model.njnt)]
    chosen = [servos[name] for name in names]
    inertias = _inertias(model)
    _refuse_weightless(names, inertias)
    bank, period_s = drives(names, chosen, inertias)
    weightless = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    hand = dataclasses.replace(
        trx.HAND,
        name=name,
        bodies=tuple(_bodies(model, data, chosen, bank)),
        fingertips=(),
        grasp_rad=(0.0,) * model.njnt,
        preload_rad=(0.0,) * model.njnt,
    )
    return Spec(
        hand=hand,
        stick=sticks.STICKS["reference"],
        contact=trx.CONTACT,
        timing=Timing(drive_s=period_s),
        gravity_m_s2=_vec(np.zeros(3) if weightless else model.opt.gravity),
    )


def left_out(xml: str, spans: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """What the MJCF text has and the mechanism lacks, in words; raises MjcfError.

    `spans` holds the lowest and the highest position of each joint [rad or m]: end stops count
    where a joint comes near one.
    """
    model, _ = _compiled(xml)
    touching = ((model.geom_contype != 0) & (model.geom_conaffinity != 0)).sum()
    stopped = [
        name
        for j in np.flatnonzero(model.jnt_limited)
        if (name := model.joint(j).name) in spans and _reaches(spans[name], model.jnt_range[j])
    ]
    said = {
        f"contacts of {touching} geoms: the mechanism moves in free air": touching > 1,
        f"end stops, which the log reaches: {', '.join(stopped)}": bool(stopped),
        f"{model.nu} actuators: drives stand in log.yaml": model.nu > 0,
    }
    return tuple(text for text, applies in said.items() if applies)


def _reaches(span: tuple[float, float], stops: np.ndarray) -> bool:
    """Whether a motion comes within NEAR of an end stop."""
    near = NEAR * (stops[1] - stops[0])
    return bool(span[0] < stops[0] + near or span[1] > stops[1] - near)


def _compiled(xml: str) -> tuple[mujoco.MjModel, str]:
    """The compiled model, without meshes, and its name."""
    text = bounded(xml)
    try:
        model = mujoco.MjSpec.from_string(text)
        for part in (*model.geoms, *model.meshes, *model.hfields, *model.textures):
            if not isinstance(part, mujoco.MjsGeom) or part.type in FROM_FILES:
                model.delete(part)
        return model.compile(), model.modelname
    except (ValueError, RuntimeError) as error:
        raise MjcfError(f"MuJoCo cannot compile it: {one_line(str(error))}") from None


def _inertias(model: mujoco.MjModel) -> Inertias:
    """Mass matrices of the links at random poses, and inertia and friction on the motor side."""
    room = np.array([ROOM[int(kind)] for kind in model.jnt_type])
    ends = np.stack([-room, room], axis=1)
    ends = np.where(model.jnt_limited[:, None] != 0, model.jnt_range, ends)
    data, found = mujoco.MjData(model), np.zeros((POSES, model.nv, model.nv))
    for k, share in enumerate(np.random.default_rng(0).uniform(size=(POSES, model.nv))):
        data.qpos[:] = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_fullM(model, data, found[k])
    return Inertias(
        motor_kgm2=model.dof_armature.copy(),
        link_kgm2=found - np.diag(model.dof_armature),
        coulomb_nm=model.dof_frictionloss.copy(),
        viscous_nms_rad=np.array(model.dof_damping, dtype=float),
    )


def _refuse_weightless(names: Sequence[str], inertias: Inertias) -> None:
    """Raise MjcfError if a joint moves next to nothing, which is a slip of the pen."""
    moved = np.einsum("pjj->pj", inertias.link_kgm2).max(axis=0)
    for name, inertia in zip(names, moved, strict=True):
        if not inertia >= LEAST_KGM2:
            raise MjcfError(
                f"joint '{name}' moves {inertia:.2g} kg m^2, of a slide kg; allowed: from "
                f"{LEAST_KGM2:g}; correct the masses and inertias of its bodies"
            )


def _bodies(
    model: mujoco.MjModel, data: mujoco.MjData, servos: Sequence[Servo], bank: Sequence[Drive]
) -> list[Body]:
    """The moving bodies in kinematic order; a body with several joints becomes several bodies."""
    carriers: dict[int, tuple[str | None, Array]] = {}
    found: list[Body] = []
    for b in range(model.nbody):
        if model.body_weldid[b] == 0:  # it stands still: what it carries, the world carries
            carriers[b] = (None, np.zeros(3))
            continue
        parent, at_m = carriers[model.body_parentid[b]]
        name, first = model.body(b).name or f"body{b}", model.body_jntadr[b]
        axes = [
            (_joint(model, data, j, servos[j], bank[j]), data.xanchor[j])
            for j in range(first, first + model.body_jntnum[b])
        ]
        for joint, anchor_m in axes[:-1]:
            found.append(_empty(f"{name}.{joint.name}", parent, anchor_m - at_m, joint))
            parent, at_m = found[-1].name, anchor_m
        joint, anchor_m = axes[-1] if axes else (_fixed(name), data.xpos[b])
        found.append(_filled(_empty(name, parent, anchor_m - at_m, joint), model, data, b))
        carriers[b] = (name, anchor_m)
    return found


def _empty(name: str, parent: str | None, origin_m: Array, joint: Joint) -> Body:
    """A body without mass."""
    return Body(
        name=name,
        parent=parent,
        origin_m=_vec(origin_m),
        joint=joint,
        mass_kg=0.0,
        com_m=(0.0, 0.0, 0.0),
        inertia_kgm2=(0.0, 0.0, 0.0),
    )


def _filled(empty: Body, model: mujoco.MjModel, data: mujoco.MjData, b: int) -> Body:
    """A body with mass and inertia of the model's body `b`, axes parallel to the world frame."""
    first, count = model.body_jntadr[b], model.body_jntnum[b]
    anchor_m = data.xanchor[first + count - 1] if count else data.xpos[b]
    turn = data.ximat[b].reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[b]) @ turn.T
    return dataclasses.replace(
        empty,
        mass_kg=float(model.body_mass[b]),
        com_m=_vec(data.xipos[b] - anchor_m),
        inertia_kgm2=_vec(np.diag(inertia)),
        products_kgm2=_vec(inertia[[0, 0, 1], [1, 2, 2]]),
    )


def _fixed(body: str) -> Joint:
    return Joint(name=f"{body}_fixed", axis=(0.0, 0.0, 1.0), range_rad=(-1.0, 1.0), drive=None)


def _joint(model: mujoco.MjModel, data: mujoco.MjData, j: int, servo: Servo, drive: Drive) -> Joint:
    kind = int(model.jnt_type[j])
    low, high = model.jnt_range[j] if model.jnt_limited[j] else (-ROOM[kind], ROOM[kind])
    return Joint(
        name=model.joint(j).name,
        axis=_vec(data.xaxis[j]),
        range_rad=(float(low), float(high)),
        drive=drive,
        sensor=servo.sensor,
        slides=kind == int(mujoco.mjtJoint.mjJNT_SLIDE),
    )


def _vec(values: Array) -> Vec3:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
