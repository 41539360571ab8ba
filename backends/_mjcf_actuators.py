"""The drives that a user's MJCF itself has: what its actuators do on each joint.

The force of an actuator is gain * ctrl + bias0 + bias1 * length + bias2 * velocity, where length is
the joint's position times a lever: the gear, of a fixed tendon times its coefficient. So position
servos, dampers, and general actuators alike are PD laws whose numbers are sums over a joint's
actuators; motors only bound the torque.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from backends._mjcf_followers import followers, line

TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
FIXED, AFFINE = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
LINEAR = (mujoco.mjtBias.mjBIAS_NONE, AFFINE)


@dataclass(frozen=True, kw_only=True)
class FileDrive:
    """What a file says of one joint's drive, at the joint [Nm, rad, s]; of a slide [N, m, s]."""

    kp: float | None = None
    """Proportional gain; None: no actuator holds a position."""
    kd: float = 0.0
    """Derivative gain."""
    limit: float | None = None
    """Largest torque."""
    armature: float = 0.0
    """Inertia on the motor's side [kg m^2], of a slide [kg]."""
    damping: float = 0.0
    """Viscous friction that is no part of the control law."""
    odd: tuple[str, ...] = ()
    """What its actuators do that is not simulated, in words."""


def file_drive(model: mujoco.MjModel, j: int) -> FileDrive:
    """The drive of joint `j`, a hinge or slide."""
    dof = model.jnt_dofadr[j]
    own = {a: by for a in range(model.nu) if (by := lever(model, a, j))}
    kp, kd, most, odd = 0.0, 0.0, 0.0, list[str]()
    armature, damping = float(model.dof_armature[dof]), float(model.dof_damping[dof])
    for a, by in own.items():
        armature += by**2 * float(model.actuator_armature[a])
        damping += by**2 * float(model.actuator_damping[a])
        odd += _odd(model, a)
        most += _limit(model, a, by)
        if int(model.actuator_biastype[a]) == AFFINE:
            kp -= by**2 * float(model.actuator_biasprm[a, 1])
            kd -= by**2 * float(model.actuator_biasprm[a, 2])
    limit = most if own else np.inf
    if model.jnt_actfrclimited[j]:
        limit = min(limit, float(np.abs(model.jnt_actfrcrange[j]).min()))
    return FileDrive(
        kp=kp if kp > 0.0 else None,
        kd=max(kd, 0.0),
        limit=limit if 0.0 < limit < np.inf else None,
        armature=armature,
        damping=damping,
        odd=tuple(odd),
    )


def lever(model: mujoco.MjModel, a: int, j: int) -> float:
    """How far actuator `a` moves per move of joint `j`, with all that follows it; 0: not at all.

    Through the joint itself or a fixed tendon, whose other joints stand still.
    """
    gear, at = float(model.actuator_gear[a, 0]), int(model.actuator_trnid[a, 0])
    if int(model.actuator_trntype[a]) in JOINT:
        return gear if at == j else 0.0
    pulls = line(model, at) if int(model.actuator_trntype[a]) == TENDON else None
    if pulls is None:
        return 0.0
    led = followers(model, [j], ())[0].items()
    return gear * (pulls.get(j, 0.0) + sum(pulls.get(k, 0.0) * one.rate for k, one in led))


def _limit(model: mujoco.MjModel, a: int, gear: float) -> float:
    """The largest torque of an actuator in both directions; infinite without a limit."""
    if model.actuator_forcelimited[a]:
        return abs(gear) * float(np.abs(model.actuator_forcerange[a]).min())
    motor = int(model.actuator_biastype[a]) != AFFINE and int(model.actuator_gaintype[a]) == FIXED
    if motor and model.actuator_ctrllimited[a]:
        gain = float(model.actuator_gainprm[a, 0])
        return abs(gear * gain) * float(np.abs(model.actuator_ctrlrange[a]).min())
    return np.inf


def _odd(model: mujoco.MjModel, a: int) -> list[str]:
    """What an actuator does that no PD law does."""
    name = model.actuator(a).name or f"number {a}"
    found = {
        "a filter or an integrator": model.actuator_dyntype[a] != 0,
        "a gain that is not constant": model.actuator_gaintype[a] != FIXED,
        "a bias that is not linear": int(model.actuator_biastype[a]) not in LINEAR,
        "a delay": np.any(model.actuator_delay[a]),
        "damping that is not linear": np.any(model.actuator_dampingpoly[a]),
    }
    return [f"actuator '{name}' has {what}" for what, there in found.items() if there]
