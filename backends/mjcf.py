"""Build the spec of a user's mechanism from its MJCF file and the settings of its drives.

The model that MuJoCo's compiler makes of the file is written at the zero pose, where every joint
reads 0, in frames parallel to the world frame. In this project `armature` is the inertia on the
motor side of the gear; `damping` and `frictionloss` are the friction there. This module knows
nothing about logs.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np

from backends import sticks, trx
from backends._mjcf_actuators import FileDrive, file_drive
from backends._mjcf_checks import moved, problems
from backends._mjcf_drives import Inertias, Servo, drives
from backends._mjcf_followers import Follower, followers
from backends._mjcf_model import compiled, end_m, whole
from backends._mjcf_play import Plain, Play
from backends._mjcf_robot import robot_file
from backends._mjcf_text import MjcfError
from backends._mjcf_write import JointNumbers, written
from backends._urdf_write import written_urdf
from backends.spec import Body, Command, Drive, Joint, Loop, Spec, Timing, Vec3
from backends.state import Array

__all__ = [
    "FileDrive",
    "JointNumbers",
    "MjcfError",
    "Plain",
    "Play",
    "Servo",
    "file_drives",
    "in_file",
    "joint_ranges",
    "left_out",
    "mechanism",
    "robot_file",
    "whole",
    "written",
    "written_urdf",
]

POSES = 32
"""Number of random poses, within the joint ranges, at which the inertias of the links are
evaluated."""
ROOM = {int(mujoco.mjtJoint.mjJNT_HINGE): np.pi, int(mujoco.mjtJoint.mjJNT_SLIDE): 1.0}
"""Range of a joint without limits, to either side [rad or m]."""
LEAST_KGM2 = 1e-9
"""Least inertia that a joint moves: that of a needle of 1 mg and 5 cm [kg m^2], of a slide [kg]."""
NEAR = 0.01
"""Distance from an end stop at which it may act, over the joint's range."""
GUESSED_ARMATURE = 0.1
"""Where neither file nor log knows a motor's inertia, it is this share of the least that its links
have: small, and uncertain (`diagnosis.replay.nominal`)."""


def mechanism(
    xml: str,
    servos: Mapping[str, Servo],
    *,
    held: Mapping[str, float] | None = None,
    fix_base: bool = False,
    carried: float = 0.0,
    geared: bool = True,
    room: Mapping[str, float] | None = None,
) -> Spec:
    """The mechanism of an MJCF or URDF text with a drive on each joint that `servos` names.

    Joints that follow these by an equality do so. All others are held: where `held` says [rad, m],
    else where the file has them; a free base only with `fix_base`. `carried`: the share of all
    weight that drives carry. `geared`: refuse drives whose gears no period suits. `room`: how far
    to either side joints without limits go [rad, m], where that is more than `ROOM`. Palm, taxels
    and grip are copied from the default hand and touch nothing. Raises MjcfError.
    """
    model, hold = compiled(xml), held or {}
    wrong = problems(model, list(servos), list(hold), fix_base)
    if wrong:
        raise MjcfError("; ".join(wrong))
    own = [j for j in range(model.njnt) if model.joint(j).name in servos]
    led, names = followers(model, own, hold)[0], [model.joint(j).name for j in own]
    chosen = [servos[name] for name in names]
    data = _posed(model, [*own, *led], hold)
    inertias = _inertias(model, own, led, chosen, data.qpos.copy())
    _refuse_weightless(names, inertias)
    bank, period_s = drives(names, chosen, inertias, geared)
    bank = tuple(
        dataclasses.replace(drive, spring_nm_rad=stiffness, spring_rest_rad=rest)
        for drive, (stiffness, rest) in zip(bank, _springs(model, own, led), strict=True)
    )
    joints = {
        j: _joint(model, data, j, servo, drive, (room or {}).get(name, 0.0))
        for j, name, servo, drive in zip(own, names, chosen, bank, strict=True)
    }
    joints |= {j: _follower(model, data, j, one) for j, one in led.items()}
    hand = dataclasses.replace(
        trx.HAND,
        name=_name(xml),
        bodies=tuple(_bodies(model, data, joints, carried)),
        fingertips=(),
        grasp_rad=(0.0,) * len(own),
        preload_rad=(0.0,) * len(own),
    )
    return Spec(
        hand=hand,
        stick=sticks.STICKS["reference"],
        contact=trx.CONTACT,
        timing=Timing(drive_s=period_s),
        gravity_m_s2=_vec(model.opt.gravity * float(_weighs(model))),
    )


def file_drives(xml: str) -> dict[str, FileDrive]:
    """What an MJCF or URDF text says of the drives of its hinges and slides; raises MjcfError."""
    model = compiled(xml)
    hinges = [j for j in range(model.njnt) if int(model.jnt_type[j]) in ROOM]
    return {model.joint(j).name: file_drive(model, j) for j in hinges}


def joint_ranges(xml: str) -> dict[str, tuple[float, float, bool]]:
    """Range of each hinge [rad] and slide [m] of a text, and whether it slides.

    In the file's order; raises MjcfError.
    """
    model = compiled(xml)
    found: dict[str, tuple[float, float, bool]] = {}
    for j in range(model.njnt):
        kind = int(model.jnt_type[j])
        if kind in ROOM:
            low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
            slides = kind == int(mujoco.mjtJoint.mjJNT_SLIDE)
            found[model.joint(j).name] = float(low), float(high), slides
    return found


def leaders(xml: str, joints: Collection[str]) -> dict[str, str]:
    """Joints of a text that follow some of `joints` along a line, and whom; raises MjcfError."""
    model = compiled(xml)
    led = followers(model, [j for j in range(model.njnt) if model.joint(j).name in joints], ())[0]
    lines = {j: one.leader for j, one in led.items() if len(one.course) == 2}
    return {model.joint(j).name: model.joint(leader).name for j, leader in lines.items()}


def left_out(xml: str, spans: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """What the MJCF text has and the mechanism lacks, in words; raises MjcfError.

    `spans` holds the lowest and the highest position of each joint that moves [rad or m]: end stops
    count where a joint comes near one.
    """
    model = compiled(xml)
    own = [j for j in range(model.njnt) if model.joint(j).name in spans]
    led = followers(model, own, ())[0]
    touching = ((model.geom_contype != 0) & (model.geom_conaffinity != 0)).sum()
    stopped = [
        name
        for j in own
        if model.jnt_limited[j] and _reaches(spans[name := model.joint(j).name], model.jnt_range[j])
    ]
    resting = [
        model.joint(j).name or f"number {j}"
        for j in range(model.njnt)
        if j not in own and j not in led and int(model.jnt_type[j]) in ROOM
    ]
    odd = [text for name, one in file_drives(xml).items() if name in spans for text in one.odd]
    said = {
        f"contacts of {touching} geoms: the mechanism moves in free air": touching > 1,
        f"end stops, which the log reaches: {', '.join(stopped)}": bool(stopped),
        f"joints of which the log has no commands, which are held: {', '.join(resting)}": bool(
            resting
        ),
        "; ".join(odd): bool(odd),
    }
    return tuple(text for text, applies in said.items() if applies)


def _name(xml: str) -> str:
    """The model's name."""
    root = ElementTree.fromstring(xml)
    return root.get("model" if root.tag == "mujoco" else "name") or "MuJoCo Model"


def _weighs(model: mujoco.MjModel) -> bool:
    """Whether there is gravity."""
    return not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY


def _posed(model: mujoco.MjModel, own: Sequence[int], held: Mapping[str, float]) -> mujoco.MjData:
    """The model where joints that move, or follow, read 0, and others stand where they are held."""
    data = mujoco.MjData(model)
    data.qpos[[model.jnt_qposadr[j] for j in own]] = 0.0
    for name, value in held.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(model, data)
    return data


def _reaches(span: tuple[float, float], stops: np.ndarray) -> bool:
    """Whether a motion comes within NEAR of an end stop."""
    near = NEAR * (stops[1] - stops[0])
    return bool(span[0] < stops[0] + near or span[1] > stops[1] - near)


def _inertias(
    model: mujoco.MjModel,
    own: Sequence[int],
    led: Mapping[int, Follower],
    servos: Sequence[Servo],
    pose: Array,
) -> Inertias:
    """Mass matrices of the links at random poses, and inertia and friction on the motor side.

    What a follower's joint has of these, its leader has, by how far the follower moves.
    """
    room = np.array([ROOM[int(model.jnt_type[j])] for j in own])
    ends = np.stack([-room, room], axis=1)
    ends = np.where(model.jnt_limited[own][:, None] != 0, model.jnt_range[own], ends)
    dofs, at = model.jnt_dofadr[own], model.jnt_qposadr[own]
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    found = np.zeros((POSES, len(own), len(own)))
    for k, share in enumerate(np.random.default_rng(0).uniform(size=(POSES, len(own)))):
        data.qpos[:] = pose
        data.qpos[at] = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_fullM(model, data, full)
        found[k] = full[np.ix_(dofs, dofs)]
    files = [file_drive(model, j) for j in own]
    links = found - np.diag([one.armature for one in files])
    motor = _motors(servos, files, links)
    coulomb = np.array(model.dof_frictionloss[dofs], dtype=float)
    viscous = np.array([one.damping for one in files])
    for j, one in led.items():
        behind, file, dof = own.index(one.leader), file_drive(model, j), model.jnt_dofadr[j]
        motor[behind] += one.rate**2 * file.armature
        viscous[behind] += one.rate**2 * file.damping
        coulomb[behind] += abs(one.rate) * float(model.dof_frictionloss[dof])
    return Inertias(motor_kgm2=motor, link_kgm2=links, coulomb_nm=coulomb, viscous_nms_rad=viscous)


def _springs(
    model: mujoco.MjModel, own: Sequence[int], led: Mapping[int, Follower]
) -> list[tuple[float, float]]:
    """Stiffness and rest of the springs at joints, with those of their followers [Nm/rad, rad]."""
    stiffness, rest = model.jnt_stiffness, model.qpos_spring[model.jnt_qposadr]
    found = []
    for leader in own:
        parts = [(float(stiffness[leader]), float(rest[leader]))]
        for j, one in led.items():
            if one.leader == leader and stiffness[j]:
                start, rate = one.course[:2]
                parts.append((float(stiffness[j]) * rate**2, (float(rest[j]) - start) / rate))
        whole = sum(k for k, _ in parts)
        found.append((whole, sum(k * at for k, at in parts) / whole if whole else 0.0))
    return found


def _motors(servos: Sequence[Servo], files: Sequence[FileDrive], links: Array) -> Array:
    """Inertias on the motors' side (J,): as given, of the file, or a guess.

    No less than a share of the links', or than what the drive damps critically: kd^2 / (4 kp).
    """
    given = [
        file.armature if servo.armature is None else servo.armature
        for servo, file in zip(servos, files, strict=True)
    ]
    least = np.einsum("pjj->pj", links).min(axis=0)
    damped = [(one.kd or 0.0) ** 2 / (4.0 * (one.kp or np.inf)) for one in servos]
    guess = np.maximum(GUESSED_ARMATURE * least, damped)
    return np.where(np.array(given) > 0.0, given, guess)


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
    model: mujoco.MjModel, data: mujoco.MjData, joints: Mapping[int, Joint], carried: float
) -> list[Body]:
    """The moving bodies in kinematic order; a body with several joints becomes several bodies."""
    moves = moved(model, list(joints))
    carriers: dict[int, tuple[str | None, Array]] = {}
    found: list[Body] = []
    for b in range(model.nbody):
        if b not in moves:  # it stands still: what it carries, the world carries
            carriers[b] = (None, np.zeros(3))
            continue
        parent, at_m = carriers[model.body_parentid[b]]
        name, first = model.body(b).name or f"body{b}", model.body_jntadr[b]
        axes = [
            (joints[j], data.xanchor[j])
            for j in range(first, first + model.body_jntnum[b])
            if j in joints
        ]
        for joint, anchor_m in axes[:-1]:
            found.append(_empty(f"{name}.{joint.name}", parent, anchor_m - at_m, joint))
            parent, at_m = found[-1].name, anchor_m
        joint, anchor_m = axes[-1] if axes else (_fixed(name), data.xpos[b])
        body = _empty(name, parent, anchor_m - at_m, joint)
        found.append(_filled(body, model, data, b, anchor_m, carried))
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


def in_file(
    xml: str, joints: Collection[str], held: Mapping[str, float], joint: str, point_m: Vec3
) -> Vec3:
    """A point of a body in the file's frame of it [m], from that of a `mechanism`'s world.

    Of the body that `joint` moves, in the mechanism of `joints`; for `held` see there.
    """
    model = compiled(xml)
    own = [j for j in range(model.njnt) if model.joint(j).name in joints]
    data = _posed(model, [*own, *followers(model, own, held)[0]], held)
    j, b = model.joint(joint).id, model.joint(joint).bodyid[0]
    frame = data.xmat[b].reshape(3, 3)
    return _vec(frame.T @ (point_m + data.xanchor[j] - data.xpos[b]))


def _filled(
    empty: Body,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    b: int,
    anchor_m: Array,
    carried: float,
) -> Body:
    """A body with mass and inertia of the model's body `b`, axes parallel to the world frame."""
    turn, frame = data.ximat[b].reshape(3, 3), data.xmat[b].reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[b]) @ turn.T
    return dataclasses.replace(
        empty,
        mass_kg=float(model.body_mass[b]),
        carried=1.0 - (1.0 - float(model.body_gravcomp[b])) * (1.0 - carried),
        com_m=_vec(data.xipos[b] - anchor_m),
        inertia_kgm2=_vec(np.diag(inertia)),
        products_kgm2=_vec(inertia[[0, 0, 1], [1, 2, 2]]),
        tip_m=_vec(data.xpos[b] + frame @ end_m(model, b) - anchor_m),
    )


def _fixed(body: str) -> Joint:
    return Joint(name=f"{body}_fixed", axis=(0.0, 0.0, 1.0), range_rad=(-1.0, 1.0), drive=None)


def _joint(
    model: mujoco.MjModel, data: mujoco.MjData, j: int, servo: Servo, drive: Drive, room: float
) -> Joint:
    kind = int(model.jnt_type[j])
    room = max(ROOM[kind], room)
    low, high = model.jnt_range[j] if model.jnt_limited[j] else (-room, room)
    return Joint(
        name=model.joint(j).name,
        axis=_vec(data.xaxis[j]),
        range_rad=(float(low), float(high)),
        drive=drive,
        sensor=servo.sensor,
        command=Command(slowness_s_rad=1.0 / servo.speed if servo.speed else 0.0),
        loop=Loop(**servo.loop),
        slides=kind == int(mujoco.mjtJoint.mjJNT_SLIDE),
    )


def _follower(model: mujoco.MjModel, data: mujoco.MjData, j: int, one: Follower) -> Joint:
    return Joint(
        name=model.joint(j).name,
        axis=_vec(data.xaxis[j]),
        range_rad=(-1.0, 1.0),
        drive=None,
        slides=int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE),
        follows=model.joint(one.leader).name,
        course=one.course,
    )


def _vec(values: Array) -> Vec3:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
