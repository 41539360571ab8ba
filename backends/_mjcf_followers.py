"""Joints of a user's MJCF that follow others: mimic joints, coupled fingers, linked tendons.

An equality of two joints holds one on a polynomial of the other. An equality of fixed tendons holds
a sum of joints; where two joints are in it, one follows the other along a line.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

JOINT, TENDON = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
IN_TENDON = int(mujoco.mjtWrap.mjWRAP_JOINT)
HOLD = "to hold it instead, add `hold: {{{}: 0}}` under mechanism in log.yaml"


@dataclass(frozen=True, kw_only=True)
class Follower:
    """What a joint follows."""

    leader: int
    equality: int
    """What holds it there."""
    course: tuple[float, ...]
    """Its position as a polynomial of the leader's, the lowest coefficient first [rad or m]."""

    @property
    def rate(self) -> float:
        """How far it moves per move of the leader, where that reads 0."""
        return self.course[1] if len(self.course) > 1 else 0.0


def followers(
    model: Any, moving: Sequence[int], held: Collection[str]
) -> tuple[Mapping[int, Follower], list[str]]:
    """By joint, those that follow the joints `moving`; and what cannot be followed, in words."""
    found: dict[int, Follower] = {}
    wrong = []
    for e in np.flatnonzero(model.eq_active0 != 0):
        sums = _sums(model, int(e))
        if sums is None:
            continue
        joints, said = list(sums.terms), ", ".join(model.joint(j).name for j in sums.terms)
        if not set(joints) & set(moving) or any(model.joint(j).name in held for j in joints):
            continue
        if len(joints) == 1:
            wrong.append(f"joint '{said}' is bound to a constant by an equality; delete it")
            continue
        own = [j for j in joints if j not in moving]
        if len(joints) > 2 or not own:
            wrong.append(
                f"the joints {said} are bound to each other by an equality; followed is one joint "
                "by one other, which alone is in the log: leave out the columns of the rest"
            )
            continue
        follower = own[0]
        leader = joints[0] if joints[1] == follower else joints[1]
        course = _solved(sums, leader, follower)
        if course is None or follower in found:
            name = model.joint(follower).name
            wrong.append(
                f"joint '{name}' does not follow '{model.joint(leader).name}' along one "
                f"polynomial; {HOLD.format(name)}"
            )
            continue
        found[follower] = Follower(leader=leader, equality=int(e), course=course)
    return found, wrong


@dataclass(frozen=True)
class _Sums:
    """Polynomials of positions whose sum is zero, by joint; lines but of one joint."""

    terms: dict[int, Polynomial]
    constant: float


def _sums(model: Any, e: int) -> _Sums | None:
    """What an equality of joints or tendons holds; None: it is another."""
    kind, one, other = (int(a[e]) for a in (model.eq_type, model.eq_obj1id, model.eq_obj2id))
    if kind not in (JOINT, TENDON):
        return None
    course = Polynomial(model.eq_data[e, :5])
    if kind == JOINT:
        if other < 0:
            return _Sums({one: Polynomial([0.0, 1.0])}, 0.0)
        rest = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (one, other)]
        moved = course(Polynomial([-rest[1], 1.0]))
        return _Sums({one: Polynomial([0.0, 1.0]), other: -moved}, -rest[0])
    lines = [line(model, t) for t in (one, other) if t >= 0]
    if any(pulls is None for pulls in lines) or (len(lines) == 2 and any(course.coef[2:])):
        return None
    terms: dict[int, Polynomial] = {}
    constant = -float(course.coef[0])
    for pulls, share in zip(lines, (1.0, -float(course.coef[1])), strict=False):
        for j, coefficient in (pulls or {}).items():
            zero = float(model.qpos0[model.jnt_qposadr[j]])
            terms[j] = terms.get(j, Polynomial([0.0])) + Polynomial([0.0, share * coefficient])
            constant -= share * coefficient * zero
    return _Sums(terms, constant)


def line(model: Any, t: int) -> dict[int, float] | None:
    """The coefficients of a fixed tendon by joint; None of one that runs over sites."""
    wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
    if any(int(model.wrap_type[w]) != IN_TENDON for w in wraps):
        return None
    return {int(model.wrap_objid[w]): float(model.wrap_prm[w]) for w in wraps}


def _solved(sums: _Sums, leader: int, follower: int) -> tuple[float, ...] | None:
    """The follower's position by the leader's; None where the follower's own term bends."""
    own = sums.terms[follower].trim()
    if own.degree() != 1:
        return None
    offset, rate = own.coef
    course = (-(sums.terms[leader] + sums.constant + offset) / rate).coef
    return tuple(map(float, course))
