"""A user's robot in plain MuJoCo under a log's own commands: what its own simulator would show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from backends.drive import BRISTLE_RAD, COGGING_RAD, HEAT_S, STRIBECK_RAD_S
from backends.mjcf import (
    JointNumbers,
    Plain,
    Play,
    file_drives,
    in_file,
    written,
    written_urdf,
)
from backends.spec import Command, Loop, Spec
from backends.state import Array
from diagnosis.logs.log import DriveSettings, Log, as_log_errors
from diagnosis.motion.columns import KD, KP, LEAD, OPEN, by_name, table
from diagnosis.motion.limb import Limb
from diagnosis.motion.recordings import Recording
from diagnosis.replay.agreement import apart, begun, followed
from diagnosis.replay.parts import limbs
from diagnosis.replay.robot import model_of

BESIDE = {
    "command.delay_s": ("delay_s", "s", "s"),
    "command.slowness_s_rad": ("slowness_s_rad", "s/rad", "s/m"),
    "command.resolution_rad": ("step", "rad", "m"),
    "encoder.delay_s": ("late_s", "s", "s"),
    "encoder.scale_error": ("scale", "", ""),
    "encoder.bias_rad": ("bias", "rad", "m"),
    "encoder.eccentricity_rad": ("cosine", "rad", ""),
    "encoder.eccentricity_sine_rad": ("sine", "rad", ""),
    "loop.open": ("open", "", ""),
}
"""Numbers that an MJCF has not: their names in `backends.mjcf.robot_file`, and their units."""
DRIVES = {
    "drive.cogging_nm": ("cogging_nm", "Nm", "N"),
    "drive.thermal_fade": ("thermal_fade", "", ""),
    "drive.presliding_nm": ("presliding_nm", "Nm", "N"),
    "drive.stiction_nm": ("stiction_nm", "Nm", "N"),
    "drive.load_friction": ("load_friction", "", ""),
    "drive.one_way_friction_nm": ("one_way_friction_nm", "Nm", "N"),
}
"""Numbers of drives that only that file has, likewise."""
INTEGRATOR = "implicitfast"
SOFT_FROM = 0.5
"""Dry friction that yields more is written as MuJoCo's own."""


def _in_file(log: Log, spec: Spec) -> dict[str, JointNumbers]:
    """The numbers of a world's joints, with places of payloads as a log's model has them."""
    (xml, settings), found = model_of(log), numbers_of(spec)
    for body in spec.hand.driven:
        name = body.joint.name
        if body.payload:
            at_m = in_file(xml, spec.hand.joint_names, settings.hold, name, body.payload_m)
            found[name] = replace(found[name], payload_m=at_m)
    return found


def model_text(
    log: Log, spec: Spec, nominal: Spec | None = None, step_s: float | None = None
) -> str:
    """The text of a log's model with the numbers of a world; raises LogError.

    `nominal`: without those of joints that are as in this world, and whose drives as in the file.
    `step_s`: with this time step in place of the file's.
    """
    xml, settings = model_of(log)
    kept, own = () if nominal is None else _kept(xml, spec, nominal), _beside_file(spec)
    some = {
        name: replace(one, note=_note(settings.joints.get(name, DriveSettings()), own[name]))
        for name, one in _in_file(log, spec).items()
        if name not in kept
    }
    turned = nominal is not None and spec.gravity_m_s2 != nominal.gravity_m_s2
    with as_log_errors(f"{settings.mjcf}: "):
        return written(
            xml,
            some,
            spec.gravity_m_s2 if turned else None,
            settings.hold,
            {body.joint.name: body.carried for body in spec.hand.driven},
            settings.gravity_compensation,
            step_s,
        )


def _kept(xml: str, spec: Spec, nominal: Spec) -> set[str]:
    """Joints whose numbers and signals are the nominal ones, and whose servos the file has."""
    files, before = file_drives(xml), numbers_of(nominal)
    more, known = map(_beside_file, (spec, nominal))
    return {
        name
        for name, one in numbers_of(spec).items()
        if one == before[name]
        and more[name] == known[name]
        and not one.open
        and np.allclose([files[name].kp or 0.0, files[name].kd], [one.kp, one.kd])
    }


def timestep_s(log: Log) -> float:
    """The time step of a log's model [s]."""
    return float(plain(log, model_of(log)[0], log.joints).model.opt.timestep)


def _beside_file(world: Spec) -> dict[str, dict[str, float]]:
    """What a world has of `BESIDE` and `DRIVES`, by joint."""
    signals, acts = beside(world), drives(world)
    return {name: signals.get(name, {}) | acts.get(name, {}) for name in world.hand.joint_names}


def _note(drive: DriveSettings, own: dict[str, float]) -> str:
    """What a joint's drive and signals (`own`) do that its position servo does not."""
    held = [name for name, _, _ in (*BESIDE.values(), *DRIVES.values()) if name != "open"]
    every = drive.more | {name: own[name] for name in held if own.get(name)}
    more = ", ".join(f"{name} {value:.4g}" for name, value in every.items())
    return f"the drive of this servo also has, and this file has not: {more}" if more else ""


def urdf_text(log: Log, spec: Spec, nominal: Spec) -> str | None:
    """The text of a log's URDF with what is not nominal of a world; None: it is none."""
    before = numbers_of(nominal)
    some = {name: one for name, one in _in_file(log, spec).items() if one != before[name]}
    return written_urdf(model_of(log)[0], some)


def plain(
    log: Log,
    text: str,
    joints: Sequence[str],
    step_s: float | None = None,
    world: Spec | None = None,
) -> Plain:
    """A text of a log's model in plain MuJoCo, of which `joints` move, with what is beside it.

    `step_s`: in such steps of `INTEGRATOR`, in place of the file's.
    """
    hold, integrator = model_of(log)[1].hold, INTEGRATOR if step_s else None
    more = {"beside": beside(world), "drives": drives(world)} if world else {}
    return Plain(text, joints, hold, timestep_s=step_s, integrator=integrator, **more)


def shown(world: Plain, recording: Recording, part: Spec, held: Limb | None = None) -> Array:
    """Positions (T, K) of an episode's joints in plain MuJoCo, with the gains of a part.

    `held`: open loops are held to the motion as this limb's are.
    """
    command, push, numbers = recording.command, recording.push, table(part, True)
    if len(recording.given):
        speed, torque = np.nan_to_num(recording.given).transpose(2, 0, 1)
        motors = numbers[:, OPEN] * (numbers[:, LEAD] == 0.0) > 0.0
        command = np.where(motors, torque, command)
        gain = np.where(numbers[:, OPEN] > 0.0, numbers[:, KP], 1.0)
        push = push + numbers[:, LEAD] * numbers[:, KD] * speed + np.where(motors, 0, gain * torque)
    return world.positions(
        Play(
            time_s=recording.time_s,
            command=command,
            push=push,
            sent_s=recording.sent_s,
            start=recording.start,
            rate=recording.rate,
            held=None if held is None else held.held(recording),
        )
    )


def plain_apart(log: Log, spec: Spec) -> float:
    """Largest difference of a position between replay and plain MuJoCo [rad or m].

    At the beginning of free-air episodes, in the nominal world. Raises LogError without one.
    """
    spec, worst = followed(_by_pd_alone(spec)), 0.0
    text = model_text(log, spec)
    for part in limbs(spec):
        names = part.hand.joint_names
        episodes = begun(log, part)
        step_s = Limb(spec=part, recordings=episodes, rigid=True).dt
        world = plain(log, text, names, step_s, world=spec)
        for recording in episodes:
            worst = max(worst, apart(part, recording, shown(world, recording, part), rigid=True))
    return worst


def _by_pd_alone(spec: Spec) -> Spec:
    """A world whose drives do what a position actuator does, and no more."""
    driven = []
    for body in spec.hand.driven:
        loop = body.joint.loop
        lead = loop.lead if loop.open else 0.0
        loop = Loop(open=loop.open, lead=lead, soft_friction=loop.soft_friction)
        driven.append(replace(body, joint=replace(body.joint, loop=loop, command=Command())))
    return spec.with_driven(driven)


def beside(world: Spec) -> dict[str, dict[str, float]]:
    """What a world has of `BESIDE`, by joint."""
    rows = zip(world.hand.joint_names, map(by_name, table(world, True)), strict=True)
    found = {
        joint: {name: row[number] for number, (name, _, _) in BESIDE.items() if row[number]}
        for joint, row in rows
    }
    return {joint: own for joint, own in found.items() if own}


def drives(world: Spec) -> dict[str, dict[str, float]]:
    """What a world's drives have of `DRIVES`, with all that their laws take, by joint."""
    found = {}
    for body, drive in zip(world.hand.driven, world.drives, strict=True):
        own = {name: getattr(drive, name) for name, _, _ in DRIVES.values()}
        if any(own.values()):
            found[body.joint.name] = own | {
                "torque_limit_nm": drive.torque_limit_nm,
                "cogging_period_rad": drive.cogging_period_rad or COGGING_RAD,
                "cogging_phase_rad": drive.cogging_phase_rad,
                "thermal_s": drive.thermal_s or HEAT_S,
                "presliding_rad": drive.presliding_rad or BRISTLE_RAD,
                "stribeck_rad_s": STRIBECK_RAD_S,
                "creeps": float(body.joint.loop.soft_friction > SOFT_FROM),
            }
    return found


def with_own_steps(
    log: Log, part: Spec, recordings: tuple[Recording, ...]
) -> tuple[Recording, ...]:
    """A limb's recordings with what its model's own simulator does otherwise (`Recording.own`).

    Nothing where its drives do more than a model can hold, or where it does not simulate.
    """
    given = any(len(recording.given) for recording in recordings)
    if given or part != _by_pd_alone(part):
        return recordings
    names, step_s = part.hand.joint_names, Limb(spec=part, recordings=recordings, rigid=True).dt
    text = model_text(log, part)
    worlds = plain(log, text, names), plain(log, text, names, step_s)
    found = []
    for recording in recordings:
        punctual = replace(recording, sent_s=None)
        own, small = (shown(world, punctual, part) for world in worlds)
        known = np.isfinite(own - small).all()
        found.append(replace(recording, own=own - small if known else None))
    return tuple(found)


def numbers_of(spec: Spec) -> dict[str, JointNumbers]:
    """The numbers of a world's joints, as an MJCF has them."""
    found = {}
    for body, drive in zip(spec.hand.driven, spec.drives, strict=True):
        loop, (low, high), inside = body.joint.loop, body.joint.range_rad, drive.end_stop_rad
        motor, given = bool(loop.open and not loop.lead), 1.0 - drive.weakness
        found[body.joint.name] = JointNumbers(
            kp=given * drive.kp_nm_rad if motor or not loop.open else 0.0,
            kd=given * drive.kd_nms_rad,
            open=motor,
            limit=given * drive.torque_limit_nm,
            armature=drive.rotor_inertia_kgm2,
            damping=drive.viscous_nms_rad,
            frictionloss=drive.coulomb_nm,
            creeps=loop.soft_friction > SOFT_FROM,
            mass_kg=body.mass_kg,
            payload=body.payload,
            play=drive.play_rad,
            stiffness=drive.spring_nm_rad,
            rest=drive.spring_rest_rad,
            zero=drive.zero_rad,
            ends=(low - min(inside, 0.0), high - max(inside, 0.0)) if inside else None,
        )
    return found
