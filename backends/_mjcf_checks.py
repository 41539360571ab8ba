"""Check what in a user's MJCF cannot be simulated here; each message says what to do instead."""

import difflib
from collections.abc import Collection
from typing import Any

import numpy as np

KINDS = ("free", "ball", "slide", "hinge")
"""Joint types in MuJoCo's numbering."""
ALLOWED = ("slide", "hinge")


def problems(model: Any, servos: Collection[str]) -> list[str]:
    """Problems of a compiled model and of the names of its drives; empty if there are none."""
    joints = [model.joint(j).name for j in range(model.njnt)]
    found = [
        problem
        for j, name in enumerate(joints)
        if (problem := _of_joint(KINDS[int(model.jnt_type[j])], name, servos))
    ]
    for name in servos:
        if name not in joints:
            near = difflib.get_close_matches(name, joints, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            known = ", ".join(joints) or "none"
            found.append(f"there is a drive for '{name}', but the joints are: {known}{hint}")
    return found or _foreign(model) + [
        problem for j, name in enumerate(joints) if (problem := _forces(model, j, name))
    ]


def _of_joint(kind: str, name: str, servos: Collection[str]) -> str | None:
    if kind not in ALLOWED:
        return (
            f"joint '{name}' is a {kind} joint; allowed: {' and '.join(ALLOWED)}; delete it, so "
            "that its body is fixed, or write it as hinges"
        )
    if not name:
        return "a joint has no name; name every joint as in the log"
    if name not in servos:
        return (
            f"joint '{name}' has no drive; give its kp and kd in log.yaml, or delete it from the "
            "MJCF, so that its body is fixed"
        )
    return None


def _foreign(model: Any) -> list[str]:
    """Forces between or on bodies that these equations do not contain."""
    parts = {
        "tendons": model.ntendon,
        "equality constraints": model.neq,
        "flexible bodies": model.nflex,
        "plug-ins": model.nplugin,
        "gravity compensation (gravcomp)": np.any(model.body_gravcomp),
        "air or water (density, viscosity)": model.opt.density or model.opt.viscosity,
    }
    return [f"it has {what}; allowed: none; delete them" for what, there in parts.items() if there]


def _forces(model: Any, j: int, name: str) -> str | None:
    """Problems with the forces on joint `j`."""
    if model.jnt_stiffness[j] or np.any(model.jnt_stiffnesspoly[j]):
        return f"joint '{name}' has a spring (stiffness); allowed: none; delete it"
    if np.any(model.dof_dampingpoly[j]):
        return f"joint '{name}' has damping that is not linear; give one number"
    for what, value in (
        ("frictionloss", model.dof_frictionloss[j]),
        ("damping", model.dof_damping[j]),
    ):
        if not value >= 0.0:
            return f"joint '{name}' has {what} {value:g}, which drives it; allowed: from 0"
    if model.dof_armature[j] <= 0.0:
        return (
            f"joint '{name}' has no armature: the inertia on the motor's side of the gear, which "
            "is the rotor's times the gear ratio squared [kg m^2], of a slide [kg]; if you cannot "
            "know it, write about what the link has and a nominal_uncertainty of 0.5 in log.yaml"
        )
    return None
