"""Check what in a user's MJCF cannot be simulated here; each message says what to do instead."""

import difflib
from collections.abc import Collection, Sequence
from typing import Any

import mujoco
import numpy as np

from backends._mjcf_followers import followers, line

KINDS = ("free", "ball", "slide", "hinge")
"""Joint types in MuJoCo's numbering."""
ALLOWED = ("slide", "hinge")
SITE = int(mujoco.mjtWrap.mjWRAP_SITE)
WELD, CONNECT = (int(getattr(mujoco.mjtEq, f"mjEQ_{kind}")) for kind in ("WELD", "CONNECT"))


def listed(names: Sequence[str], verb: str = "") -> str:
    """Joints in words, with a verb in the right number: 'joints 'a', 'b' have'."""
    said = ", ".join(f"'{name}'" for name in names)
    one, more = {"have": ("has", "have"), "are": ("is", "are")}.get(verb, (verb, verb))
    if len(names) == 1:
        return f"joint {said} {one}".rstrip()
    return f"joints {said} {more}".rstrip()


def problems(
    model: Any, moving: Collection[str], held: Collection[str], fix_base: bool
) -> list[str]:
    """Problems of a compiled model whose joints `moving` have a drive; empty if there are none.

    `held`: joints that the user knows to be held. All other joints are held as well.
    """
    joints = [model.joint(j).name for j in range(model.njnt)]
    unknown = _unknown(joints, [*moving, *held])
    if unknown:
        return unknown
    there = set(moving)
    kinds = {name: KINDS[int(model.jnt_type[j])] for j, name in enumerate(joints)}
    wrong = [name for name in joints if name in there and kinds[name] not in ALLOWED]
    if wrong:
        said = ", ".join(sorted({kinds[name] for name in wrong}))
        return [
            f"{listed(wrong, 'are')} of type {said}; allowed: {' and '.join(ALLOWED)}; "
            "leave out their columns, so that they are held, or write them as hinges"
        ]
    every = [j for j, name in enumerate(joints) if name in there]
    found = [] if fix_base else _floating(model, every)
    found += _foreign(model, every, set(held)) + _springs(model, every, set(held))
    return found + _forces(model, every) + _pulled(model, every)


def _unknown(joints: Sequence[str], named: Sequence[str]) -> list[str]:
    found = []
    for name in dict.fromkeys(named):
        if name not in joints:
            near = difflib.get_close_matches(name, joints, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            known = ", ".join(filter(None, joints)) or "none"
            found.append(f"it has no joint '{name}', it has: {known}{hint}")
    return found


def _floating(model: Any, moving: Sequence[int]) -> list[str]:
    """A free base that carries joints which move."""
    for j in moving:
        for b in carriers(model, int(model.jnt_bodyid[j])):
            first, count = model.body_jntadr[b], model.body_jntnum[b]
            if any(KINDS[int(model.jnt_type[k])] == "free" for k in range(first, first + count)):
                return [
                    f"its base, body '{model.body(b).name}', floats; --fix-base, or `fix_base: "
                    "true` under mechanism in log.yaml, holds it where the file has it"
                ]
    return []


def carriers(model: Any, b: int) -> list[int]:
    """A body and those that carry it, up to the world."""
    found = [b]
    while found[-1] != 0:
        found.append(int(model.body_parentid[found[-1]]))
    return found


def moved(model: Any, moving: Sequence[int]) -> set[int]:
    """The bodies that some of these joints move."""
    at = {int(model.jnt_bodyid[j]) for j in moving}
    return {b for b in range(model.nbody) if at & set(carriers(model, b))}


def _foreign(model: Any, moving: Sequence[int], held: set[str]) -> list[str]:
    """Forces between or on bodies that these equations do not contain."""
    bodies = moved(model, [*moving, *followers(model, moving, held)[0]])
    parts = {
        "springs or friction in tendons": _pulling(model, moving),
        "constraints between bodies that move (connect, weld)": _bound(model, bodies),
        "flexible bodies": model.nflex,
        "plug-ins": model.nplugin,
        "air or water (density, viscosity)": model.opt.density or model.opt.viscosity,
    }
    found = [f"it has {what}; allowed: none; delete them" for what, there in parts.items() if there]
    return found + followers(model, moving, held)[1]


def _bound(model: Any, bodies: set[int]) -> bool:
    at = model.eq_objtype == int(mujoco.mjtObj.mjOBJ_BODY)
    for e in np.flatnonzero(model.eq_active0 != 0):
        if int(model.eq_type[e]) not in (WELD, CONNECT):
            continue
        ends = {int(model.eq_obj1id[e]), int(model.eq_obj2id[e])}
        if not at[e]:
            ends = {int(model.site_bodyid[site]) for site in ends}
        if ends & bodies:
            return True
    return False


def _pulling(model: Any, moving: Sequence[int]) -> bool:
    """Whether tendons with forces of their own span joints that move."""
    bodies = moved(model, moving)
    for t in range(model.ntendon):
        own = (model.tendon_stiffness[t], model.tendon_damping[t], model.tendon_frictionloss[t])
        if not any(own):
            continue
        first, count = model.tendon_adr[t], model.tendon_num[t]
        for w in range(first, first + count):
            kind, at = int(model.wrap_type[w]), int(model.wrap_objid[w])
            if kind == int(mujoco.mjtWrap.mjWRAP_JOINT) and at in moving:
                return True
            if kind == SITE and int(model.site_bodyid[at]) in bodies:
                return True
    return False


def _pulled(model: Any, moving: Sequence[int]) -> list[str]:
    """Actuators on tendons that move more than one joint, or run over sites."""
    found, bodies = [], moved(model, moving)
    for a in np.flatnonzero(model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)):
        t = int(model.actuator_trnid[a, 0])
        pulls = line(model, t)
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        sites = [w for w in wraps if int(model.wrap_type[w]) == SITE]
        name = f"actuator '{model.actuator(a).name or f'number {a}'}'"
        own = [model.joint(j).name for j in pulls or () if j in moving]
        if pulls is None and {int(model.site_bodyid[model.wrap_objid[w]]) for w in sites} & bodies:
            found.append(
                f"{name} pulls a tendon over sites; allowed: fixed tendons; put a position "
                "actuator on each joint of the log in its place"
            )
        elif len(own) > 1:
            found.append(
                f"{name} moves {listed(own)} at once, by a tendon; simulated is one of them, with "
                "what follows it by an equality: bind the others to it, and leave their columns out"
            )
    return found


def _springs(model: Any, moving: Sequence[int], held: Collection[str]) -> list[str]:
    """Springs of joints that move, and of those that follow them, whose torque is no line."""
    led, names = followers(model, moving, held)[0], list[str]()
    for j in (*moving, *led):
        is_curve = j in led and len(led[j].course) != 2
        if np.any(model.jnt_stiffnesspoly[j]) or (is_curve and model.jnt_stiffness[j]):
            names.append(model.joint(j).name)
    text = "{} a spring that is not linear in the logged joint; give it one stiffness, or delete it"
    return [text.format(listed(names, "have"))] if names else []


def _forces(model: Any, moving: Sequence[int]) -> list[str]:
    """Problems with the forces on joints that move, by problem: all its joints at once."""
    dofs = [int(model.jnt_dofadr[j]) for j in moving]
    tests: dict[str, list[Any]] = {
        "{} damping that is not linear; give one number": [
            np.any(model.dof_dampingpoly[d]) for d in dofs
        ],
        "{} a frictionloss below 0, which drives it; allowed: from 0": [
            not model.dof_frictionloss[d] >= 0.0 for d in dofs
        ],
        "{} a damping below 0, which drives it; allowed: from 0": [
            not model.dof_damping[d] >= 0.0 for d in dofs
        ],
    }
    found = []
    for text, wrong in tests.items():
        names = [model.joint(j).name for n, j in enumerate(moving) if wrong[n]]
        if names:
            found.append(text.format(listed(names, "have")))
    return found
