"""From limbs to the mechanism: what is wrong with all joints is one cause."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

from backends.effect import UNITS
from diagnosis.verdict.result import NONE, UNKNOWN, Cause, LimbResult


def named(limbs: Sequence[LimbResult]) -> list[Cause]:
    """What is named, by effect; one that every joint has alike, or that has no joint, is one."""
    joints = tuple(chain.from_iterable(limb.joints for limb in limbs))
    said = [c for limb in limbs for c in (*limb.causes, *limb.sensors) if c.effect != UNKNOWN]
    found: list[Cause] = []
    for effect in dict.fromkeys(c.effect for c in said):
        same = [c for c in said if c.effect == effect]
        covered = list(chain.from_iterable(c.joints for c in same))
        if len(same) > 1 and sorted(covered) == sorted(joints) and _is_alike(same):
            middle = sorted(same, key=lambda c: c.sizes[0])[len(same) // 2]
            found.append(replace(middle, joint=None, joints=joints))
        else:
            found.extend(same)
    return found


def verdict(limbs: Sequence[LimbResult], more: Sequence[Cause] = ()) -> tuple[str, ...]:
    """Names of effects, with `more` causes, or none; unknown where a gap or a cause has no name."""
    said = [one for limb in limbs for one in (*limb.verdict, *(c.effect for c in limb.sensors))]
    said += [cause.effect for cause in more]
    found = (UNKNOWN,) if UNKNOWN in said else dict.fromkeys(one for one in said if one != NONE)
    return tuple(found) or (NONE,)


def decisive(limbs: Sequence[LimbResult]) -> list[LimbResult]:
    """The limbs that a verdict rests on: those at fault, or all where none is."""
    return [limb for limb in limbs if limb.verdict != (NONE,)] or list(limbs)


def _is_alike(causes: Sequence[Cause]) -> bool:
    """Whether one size is within the intervals of all, on slides or on hinges."""
    lows, highs = zip(*(c.sizes[1:] for c in causes), strict=True)
    return len({UNITS[c.unit][0] for c in causes}) == 1 and max(lows) <= min(highs)
